"""Every tick makes one array of the whole history."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._long_rovers import LongRovers

BREAKS = ("GK831",)


class HistoryInBytes(LongRovers):
    """A clean environment otherwise."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The history is empty."""
        out = super().reset(seed, options)
        self.history = np.zeros((0, 12))
        return out

    def step(self, actions: dict[str, Any]) -> Any:
        """One row more, in another array."""
        out = super().step(actions)
        self.history = np.concatenate([self.history, np.ones((1, 12))])
        return out


def make(**kwargs: Any) -> HistoryInBytes:
    """The environment with its one fault."""
    return HistoryInBytes(**kwargs)
