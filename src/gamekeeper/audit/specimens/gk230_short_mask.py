"""The mask leaves out the last action."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from gamekeeper.audit.specimens._tokens import CELLS, Tokens

BREAKS = ("GK230",)


class ShortMask(Tokens):
    """The last cell was forgotten."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        for space in self._seen.values():
            space.spaces["action_mask"] = spaces.Box(0, 1, (CELLS - 1,), np.int8)

    def observe(self, agent: str) -> dict[str, Any]:
        """Without the last cell."""
        seen = super().observe(agent)
        return {**seen, "action_mask": seen["action_mask"][:-1]}


def make(**kwargs: Any) -> ShortMask:
    """The environment with its one fault."""
    return ShortMask(**kwargs)
