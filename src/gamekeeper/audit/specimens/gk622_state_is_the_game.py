"""state() gives a view of the array that the rules read again."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from gamekeeper.audit.specimens._lanterns import Lanterns

BREAKS = ("GK622",)
ALSO = ("GK612",)
"""The array that is handed out is also written to."""


class StateIsTheGame(Lanterns):
    """The state is the game's own array."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.state_space = spaces.Box(0.0, 3.0, (self.count,), np.float32)

    def state(self) -> Any:
        """The lanterns themselves."""
        return self.level


def make(**kwargs: Any) -> StateIsTheGame:
    """The environment with its one fault."""
    return StateIsTheGame(**kwargs)
