"""The None step of a dead trader leaves the rewards of the step before as they were."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK407",)


class DeadStepPays(Traders):
    """Dead steps don't clear the rewards."""

    def _was_dead_step(self, action: Any) -> None:
        """Puts the rewards of the others back."""
        stood = dict(self.rewards)
        super()._was_dead_step(action)
        self.rewards.update({agent: stood[agent] for agent in self.agents})


def make(**kwargs: Any) -> DeadStepPays:
    """The environment with its one fault."""
    return DeadStepPays(**kwargs)
