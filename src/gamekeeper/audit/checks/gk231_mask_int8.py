"""GK231."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from gymnasium import spaces

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._masks import fits, lines, masks
from gamekeeper.core.canon import type_name
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK231",
    needs=("rollout", "spaces"),
    severity=MEDIUM,
    mend="give masks as np.int8 arrays of 0 and 1: mask.astype(np.int8)",
)
def masks_are_int8_zeros_and_ones(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An action mask is an int8 array of zeros and ones, so that `space.sample(mask)` takes it.

    Gymnasium refuses masks of bool, of other whole numbers, and lists, so whoever samples as
    PettingZoo's documentation does fails at the first action. A mask whose space says int8 is also
    outside its observation space in all but name.

    Bad:

        {"observation": board, "action_mask": board == 0}                    # bool

    Good:

        {"observation": board, "action_mask": (board == 0).astype(np.int8)}
    """
    for each in masks(contract, evidence):
        if not isinstance(each.space, spaces.Discrete | spaces.MultiDiscrete):
            continue
        if fits(each.space, each.mask) is not None:  # told by another check
            continue
        seen = _fault(each.space, each.mask)
        proof = lines(evidence.api, each.agent, each.place)
        yield Occasion(
            each.trace.at(each.turn, each.agent, each.place), seen is None,
            "an int8 array of 0 and 1", seen,
            proof=f"{proof}\nenv.action_space(agent).sample(mask)",
        )  # fmt: skip


def _fault(space: Any, mask: Any) -> str | None:
    if isinstance(space, spaces.Discrete) or space.nvec.ndim != 1:
        return _fault_of(mask)
    if isinstance(mask, np.ndarray) and mask.shape == (int(space.nvec.sum()),):
        return None  # a flat one is cut by its readers, whatever its dtype
    faults = [_fault_of(part) for part in mask]
    return next((fault for fault in faults if fault is not None), None)


def _fault_of(mask: Any) -> str | None:
    if isinstance(mask, tuple):
        return next((fault for fault in map(_fault_of, mask) if fault is not None), None)
    if not isinstance(mask, np.ndarray):
        return f"a {type_name(mask)}"
    if mask.dtype != np.int8:
        return f"an array of {mask.dtype}"
    strange = mask[(mask != 0) & (mask != 1)]
    return None if strange.size == 0 else f"{strange.flat[0].item()} among the numbers"
