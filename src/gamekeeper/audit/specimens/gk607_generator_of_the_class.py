"""The generator belongs to the class, so that all instances draw from it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK607",)
ALSO = ("GK702",)
"""A copy draws from the same generator, so the original goes on otherwise beside it."""


class GeneratorOfTheClass(Rovers):
    """Whoever resets last has seeded for all."""

    shared: Any = None

    @property
    def rng(self) -> Any:
        """The generator of everybody."""
        return GeneratorOfTheClass.shared

    @rng.setter
    def rng(self, value: Any) -> None:
        if value is not None:
            GeneratorOfTheClass.shared = value


def make(**kwargs: Any) -> GeneratorOfTheClass:
    """The environment with its one fault."""
    return GeneratorOfTheClass(**kwargs)
