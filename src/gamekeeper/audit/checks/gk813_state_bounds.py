"""GK813."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._states import at, forms, space_of, stateless
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

WITHIN = "state = env.state()\nassert env.state_space.contains(state), (state, env.state_space)"
NUMBER = "state = env.state()\nassert not np.isnan(state).any(), state"


@check(
    "GK813",
    needs=("state", "rollout"),
    severity=MEDIUM,
    mend="scale state(), or widen state_space to what it can be; keep NaN out of both",
    applies=stateless,
)
def states_are_within_bounds(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """state() lies within the bounds of state_space, and is never NaN.

    Normalisation relies on the bounds; one NaN makes a critic's weights NaN for good.

    Bad:
        self.state_space = Box(0, 1, (4,))
        return self.cells / 4          # up to 1.25

    Good:
        return self.cells / 5
    """
    for fact, answer in forms(evidence):
        if answer["has_nan"]:
            where = at(fact, answer, "state.nan")
            yield Occasion(where, False, "numbers", "NaN", NUMBER)
        elif answer["is_within"] is not None:
            space = space_of(evidence, fact.where.play)["space"]
            seen = "a value in it" if answer["is_within"] else "a value outside"
            yield Occasion(
                at(fact, answer, "state.bounds"), answer["is_within"], f"in {space}", seen, WITHIN
            )
        elif answer["dtype"] is not None:
            yield Occasion(at(fact, answer, "state.nan"), True, "numbers", "numbers", NUMBER)
