"""A bid above what a trader has is refused, and no mask says so."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK221",)


class Broke(Traders):
    """Only the rich may choose from the whole action space."""

    def step(self, action: Any) -> None:
        """Refuses bids that cannot be paid."""
        agent = self.agent_selection
        if action is not None and int(action) > self.money[agent]:
            raise ValueError(f"{agent} has only {self.money[agent]}")
        super().step(action)


def make(**kwargs: Any) -> Broke:
    """The environment with its one fault."""
    return Broke(**kwargs)
