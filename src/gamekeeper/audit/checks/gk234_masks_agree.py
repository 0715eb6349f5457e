"""GK234."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._masks import movers
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.trace import MASK


@check(
    "GK234",
    needs=("rollout",),
    severity=HIGH,
    mend="make the mask once and put it into both places, or into one of them only",
)
def masks_agree(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The action mask in an agent's info is the same as the one in its observation.

    Some readers take the one, some the other: where they disagree, half of the trainers play
    another game, and choose actions that the environment refuses.

    Bad:

        infos[agent] = {"action_mask": np.ones(n, np.int8)}        # the observation's says less

    Good:

        infos[agent] = {"action_mask": observations[agent]["action_mask"].copy()}
    """
    for trace in evidence["rollout"]:
        for turn in trace.turns:
            for agent in movers(evidence.api, turn):
                seen, told = turn.observations.get(agent), turn.infos.get(agent)
                if not (isinstance(seen, dict) and isinstance(told, dict)):
                    continue
                if seen.get(MASK) is not None and told.get(MASK) is not None:
                    yield Occasion(
                        trace.at(turn, agent, f"infos[{MASK!r}]"), _same(seen[MASK], told[MASK]),
                        seen[MASK], told[MASK], proof=_proof(evidence.api, agent),
                    )  # fmt: skip


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(_same, one, other))
    try:
        return bool(np.array_equal(np.asarray(one), np.asarray(other)))
    except Exception:  # masks may be any objects
        return False


def _proof(api: str, agent: str) -> str:
    if api == "aec":
        found = "observation, _, _, _, info = env.last()"
    else:
        found = (
            f"agent = next(a for a in observations if str(a) == {agent!r})\n"
            "observation, info = observations[agent], infos[agent]"
        )
    return (
        f"{found}\n"
        f"one, other = observation[{MASK!r}], info[{MASK!r}]\n"
        "assert np.array_equal(one, other), (one, other)"
    )
