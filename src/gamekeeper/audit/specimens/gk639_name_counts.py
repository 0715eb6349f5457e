"""str(env) draws from the game's generator, for a name that nobody has."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK639",)


class NameCounts(Rovers):
    """Asking for the name draws."""

    def __str__(self) -> str:
        """A name with a number."""
        number = 0 if self.rng is None else int(self.rng.integers(100))
        return f"rovers {number}"


def make(**kwargs: Any) -> NameCounts:
    """The environment with its one fault."""
    return NameCounts(**kwargs)
