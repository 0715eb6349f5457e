"""GK211."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._observations import judged
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.space.misfit import STRUCTURE


@check(
    "GK211",
    needs=("rollout", "spaces"),
    severity=HIGH,
    mend="give what the space describes: arrays for a Box, every key of a Dict and no other",
)
def observations_have_the_form_of_their_space(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """Every observation has the type and the keys that its observation space describes.

    A policy reads `observation["action_mask"]` or `observation.shape` at every turn, also at an
    agent's last one: a list, None, or a dictionary without a key makes it crash there.

    Bad:

        return {"observation": board}                        # the space also has "action_mask"

    Good:

        return {"observation": board, "action_mask": mask}
    """
    yield from judged(evidence, STRUCTURE)
