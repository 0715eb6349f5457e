"""The wind is drawn in the order of the action dictionary."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK312",)


class DrawsByDictionary(Rovers):
    """Who stands first in the dictionary is driven first, and gets the first draw."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Drives in the order of the dictionary."""
        self.order = list(actions)
        self.waiting = dict(actions)
        return super().step(actions)

    def drive(self, agent: str, action: int) -> None:
        """The draw is that of the agent in the same place of the dictionary."""
        first = self.order.pop(0)
        super().drive(first, int(self.waiting[first]))


def make(**kwargs: Any) -> DrawsByDictionary:
    """The environment with its one fault."""
    return DrawsByDictionary(**kwargs)
