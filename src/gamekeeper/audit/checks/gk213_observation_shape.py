"""GK213."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._observations import judged
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.space.misfit import SHAPE


@check(
    "GK213",
    needs=("rollout", "spaces"),
    severity=HIGH,
    mend="give arrays of one shape, and declare that shape; pad what varies",
)
def observations_have_the_shape_of_their_space(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """Every observation has the shape of its observation space, whoever is left in the game.

    Networks have one input size. A shape that changes when another agent leaves or joins shows only
    in the episodes where that happens.

    Bad:

        return np.concatenate([self.position[a] for a in self.agents])   # shrinks with the agents

    Good:

        return np.concatenate([self.position[a] for a in self.possible_agents])
    """
    yield from judged(evidence, SHAPE)
