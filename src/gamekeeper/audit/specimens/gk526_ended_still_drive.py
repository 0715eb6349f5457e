"""A rover that has ended still drives where somebody acts for it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import MOVES, SIZE, Rovers

BREAKS = ("GK526",)


class EndedStillDrive(Rovers):
    """Moves whoever is named in the actions."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Drives those who have ended, too."""
        for agent in actions.keys() - set(self.agents):
            self.cells[agent] = (self.cells[agent] + MOVES[int(actions[agent])]) % SIZE
        return super().step(actions)


def make(**kwargs: Any) -> EndedStillDrive:
    """The environment with its one fault."""
    return EndedStillDrive(**kwargs)
