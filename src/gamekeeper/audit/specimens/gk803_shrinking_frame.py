"""The picture has a column for each live rover, and so becomes narrower."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK803",)


class ShrinkingFrame(Rovers):
    """A bar for each battery."""

    def render(self) -> Any:
        """As wide as there are rovers left."""
        if self.render_mode is None:
            return None
        frame = np.zeros((32, 8 * max(len(self.agents), 1), 3), np.uint8)
        for place, agent in enumerate(self.agents):
            frame[32 - max(self.battery[agent], 0) :, 8 * place : 8 * place + 6] = 200
        return frame


def make(**kwargs: Any) -> ShrinkingFrame:
    """The environment with its one fault."""
    return ShrinkingFrame(**kwargs)
