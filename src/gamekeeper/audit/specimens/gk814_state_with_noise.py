"""The state has a noise of its own."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK814",)


class StateWithNoise(Rovers):
    """A clean environment otherwise."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The noise begins anew."""
        self.noise = np.random.default_rng(0)
        return super().reset(seed, options)

    def state(self) -> Any:
        """A little less than it is."""
        return (super().state() * self.noise.uniform(0.9, 1.0)).astype(np.float32)


def make(**kwargs: Any) -> StateWithNoise:
    """The environment with its one fault."""
    return StateWithNoise(**kwargs)
