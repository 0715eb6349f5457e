"""A film of the episode is kept until the reset."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._long_rovers import LongRovers

BREAKS = ("GK834",)


class FilmKept(LongRovers):
    """A clean environment otherwise."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Another film."""
        self.film: list[Any] = []
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """One picture more."""
        self.film.append(np.full((128, 128, 3), self.time, np.uint8))
        return super().step(actions)


def make(**kwargs: Any) -> FilmKept:
    """The environment with its one fault."""
    return FilmKept(**kwargs)
