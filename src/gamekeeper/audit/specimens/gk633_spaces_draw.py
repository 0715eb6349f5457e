"""action_space() draws a seed for the space from the game's generator."""

from __future__ import annotations

from typing import Any

from gymnasium import spaces

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK633",)
ALSO = ("GK607",)
"""Policies ask for spaces, and a replay from paper doesn't: the same actions go another way."""


class SpacesDraw(Rovers):
    """Asking for a space draws."""

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object, seeded at every call."""
        if self.rng is not None:
            self._done[agent].seed(int(self.rng.integers(1000)))
        return self._done[agent]


def make(**kwargs: Any) -> SpacesDraw:
    """The environment with its one fault."""
    return SpacesDraw(**kwargs)
