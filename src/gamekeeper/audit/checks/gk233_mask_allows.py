"""GK233."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._masks import fits, lines, masks, parts
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK233",
    needs=("rollout", "spaces"),
    severity=HIGH,
    mend="allow an action that does nothing, end the agent, or don't let it be its turn",
)
def masks_allow_something(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The mask of a live agent that is to move allows at least one action.

    With nothing to choose from a policy crashes, or a softmax over minus infinity gives NaN. An
    all-zero mask of an agent that isn't to move, or has ended, is right.

    Bad:

        mask = np.zeros(n, np.int8)                    # it is stuck, and it is its turn

    Good:

        mask[NOOP] = 1                                 # or the agent terminates when it is stuck
    """
    for each in masks(contract, evidence):
        if fits(each.space, each.mask) is not None:
            continue
        flags = parts(each.space, each.mask)
        if not flags:
            continue
        is_stuck = not all(part.any() for part in flags)
        proof = lines(evidence.api, each.agent, each.place)
        test = (
            "all(np.any(part) for part in mask)" if isinstance(each.mask, tuple) else "mask.any()"
        )
        yield Occasion(
            each.trace.at(each.turn, each.agent, each.place), not is_stuck,
            "an action that is allowed", "none is", proof=f"{proof}\nassert {test}, mask",
        )  # fmt: skip
