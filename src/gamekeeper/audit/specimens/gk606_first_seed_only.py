"""Only the first seed of an instance is obeyed."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK606",)


class FirstSeedOnly(Traders):
    """A generator that is there stays."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Hands the seed on once."""
        super().reset(seed if self.rng is None else None, options)


def make(**kwargs: Any) -> FirstSeedOnly:
    """The environment with its one fault."""
    return FirstSeedOnly(**kwargs)
