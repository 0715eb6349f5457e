"""GK214."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._observations import judged
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.space.misfit import BOUNDS


@check(
    "GK214",
    needs=("rollout", "spaces"),
    severity=HIGH,
    mend="widen the bounds of the space to what the rules allow, or clip what is observed",
)
def observations_are_within_their_space(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """Every observation is within the bounds of its observation space, also at an agent's end.

    Learners scale by the bounds, and one-hot encode by the number of values: what is outside
    is squashed, indexes past an array, or is refused by a checker in the middle of a training.

    Bad:

        spaces.Box(-1, 1, (2,))                              # and the robot may leave the square

    Good:

        spaces.Box(-np.inf, np.inf, (2,))                    # or keep the robot inside
    """
    yield from judged(evidence, BOUNDS)
