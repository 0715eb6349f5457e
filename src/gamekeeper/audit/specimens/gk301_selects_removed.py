"""A bankrupt trader is removed, and stays selected."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK301",)


class SelectsRemoved(Traders):
    """Dead steps select nobody."""

    def _was_dead_step(self, action: Any) -> None:
        """Removes the trader, and leaves the selection as it is."""
        gone = self.agent_selection
        super()._was_dead_step(action)
        if self.agents:
            self.agent_selection = gone


def make(**kwargs: Any) -> SelectsRemoved:
    """The environment with its one fault."""
    return SelectsRemoved(**kwargs)
