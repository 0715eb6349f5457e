"""The frame is the background itself as long as nothing stands on it."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK804",)


class SharedGround(Traders):
    """Keeps one picture for each number of rounds, and hands it out."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.pictures = [np.full((8, 8, 3), 20 * k, np.uint8) for k in range(self.rounds + 1)]

    def render(self) -> Any:
        """The picture of this round, not a copy of it."""
        return None if self.render_mode is None else self.pictures[self.round]


def make(**kwargs: Any) -> SharedGround:
    """The environment with its one fault."""
    return SharedGround(**kwargs)
