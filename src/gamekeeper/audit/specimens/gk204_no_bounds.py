"""The lower bounds of the observation space are NaN: a division by a range that isn't known yet."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK204",)


class NoBounds(Rovers):
    """Nothing is in such a space, whatever is observed."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        for space in self._seen.values():
            space.low = np.full_like(space.low, np.nan)


def make(**kwargs: Any) -> NoBounds:
    """The environment with its one fault."""
    return NoBounds(**kwargs)
