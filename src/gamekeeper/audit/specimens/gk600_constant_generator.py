"""The generator is built in the constructor from a constant, and the seed is ignored."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK600",)


class ConstantGenerator(Rovers):
    """Every instance plays the one sequence of episodes."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.rng = np.random.default_rng(42)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Goes on with the generator that is there."""
        return super().reset(None, options)


def make(**kwargs: Any) -> ConstantGenerator:
    """The environment with its one fault."""
    return ConstantGenerator(**kwargs)
