"""Seed 0 is taken for no seed."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._tokens import Tokens

BREAKS = ("GK605",)


class SeedZero(Tokens):
    """Asks whether the seed is true."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """0 isn't."""
        super().reset(seed or None, options)


def make(**kwargs: Any) -> SeedZero:
    """The environment with its one fault."""
    return SeedZero(**kwargs)
