"""A bankrupt trader is taken out of the game by the step that ruins it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK302",)
ALSO = ("GK501",)
"""Its flag is never seen up."""


class RemovedByOthers(Traders):
    """Nobody hears of being bankrupt."""

    def _deads_step_first(self) -> Any:
        """Takes bankrupt traders out, unasked."""
        for agent in [a for a in self.agents if self.terminations[a]]:
            for book in (self.terminations, self.truncations, self.rewards, self.infos):
                del book[agent]
            del self._cumulative_rewards[agent]
            self.agents.remove(agent)
        return super()._deads_step_first()


def make(**kwargs: Any) -> RemovedByOthers:
    """The environment with its one fault."""
    return RemovedByOthers(**kwargs)
