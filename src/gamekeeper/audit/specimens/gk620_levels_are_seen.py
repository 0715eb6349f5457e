"""The array that the rules read again is the observation itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from gamekeeper.audit.specimens._lanterns import Lanterns

BREAKS = ("GK620",)
ALSO = (
    "GK610",
    "GK614",
)
"""One array that is handed out to all, at every turn, is also written to."""


class LevelsAreSeen(Lanterns):
    """The observation is the game's own array."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        space = spaces.Box(0.0, 3.0, (self.count,), np.float32)
        self._seen = dict.fromkeys(self.possible_agents, space)

    def observe(self, agent: str) -> Any:
        """The lanterns themselves."""
        return self.level


def make(**kwargs: Any) -> LevelsAreSeen:
    """The environment with its one fault."""
    return LevelsAreSeen(**kwargs)
