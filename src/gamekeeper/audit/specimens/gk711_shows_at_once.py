"""It says that it is parallelizable, and what one keeper sets shows to the next."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._lanterns import Lanterns

BREAKS = ("GK711",)


class ShowsAtOnce(Lanterns):
    """A wish shows before the round is settled."""

    def step(self, action: Any) -> None:
        """Shows the lantern at once."""
        agent = self.agent_selection
        if action is not None:
            self.level[self.possible_agents.index(agent)] = int(action)
        super().step(action)


def make(**kwargs: Any) -> ShowsAtOnce:
    """The environment with its one fault."""
    return ShowsAtOnce(**kwargs)
