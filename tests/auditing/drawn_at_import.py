"""A module that draws from a global generator while it is imported, and an environment of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.faults.seeds import GlobalGenerator

SAMPLE = np.random.random(3)
"""An example of some kind, as modules make one to measure its length."""


class Sampled(GlobalGenerator):
    """A coin goes to a trader that numpy's global generator draws; so does the first of all."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Draws the money of the first trader."""
        super().reset(seed, options)
        self.money[self.possible_agents[0]] += int(np.random.randint(9))
