"""The picture shows where the rovers were at the reset."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import SIZE, Rovers

BREAKS = ("GK809",)


class StillPicture(Rovers):
    """Draws the places of the start."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Notes the places."""
        out = super().reset(seed, options)
        self.start = [tuple(cell) for cell in self.cells.values()]
        return out

    def render(self) -> Any:
        """A pixel for each place."""
        if self.render_mode is None:
            return None
        frame = np.zeros((SIZE, SIZE, 3), np.uint8)
        for row, column in self.start:
            frame[row, column] = 220
        return frame


def make(**kwargs: Any) -> StillPicture:
    """The environment with its one fault."""
    return StillPicture(**kwargs)
