"""A reset without a seed takes the last one again."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._tokens import Tokens

BREAKS = ("GK609",)


class NoneReseeds(Tokens):
    """The seed is kept for later."""

    seed = 0

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Starts every unseeded episode alike."""
        self.seed = self.seed if seed is None else seed
        super().reset(self.seed, options)


def make(**kwargs: Any) -> NoneReseeds:
    """The environment with its one fault."""
    return NoneReseeds(**kwargs)
