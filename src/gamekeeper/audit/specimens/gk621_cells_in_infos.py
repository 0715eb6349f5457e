"""The cell in a rover's info is the array that the rules read again."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK621",)


class CellsInInfos(Rovers):
    """The info holds the game's own array."""

    def info(self, agent: str) -> dict[str, Any]:
        """The rover's cell itself."""
        return {"cell": self.cells[agent]}


def make(**kwargs: Any) -> CellsInInfos:
    """The environment with its one fault."""
    return CellsInInfos(**kwargs)
