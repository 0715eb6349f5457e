"""A deep copy's battery gauge is an array of its own, which nobody writes to."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK701",)
ALSO = ("GK703",)
"""A pickle tears views off like a deep copy does."""


class CopyLosesAView(Rovers):
    """A view of an array, which a deep copy tears off."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The gauge is a view of the log."""
        self.log = np.zeros((2, self.count), np.float32)
        self.gauge = self.log[1]
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Writes into the log, and pays by the gauge."""
        observations, rewards, *rest = super().step(actions)
        self.log[1] += 1.0
        return observations, {a: rewards[a] + float(self.gauge[0]) for a in rewards}, *rest


def make(**kwargs: Any) -> CopyLosesAView:
    """The environment with its one fault."""
    return CopyLosesAView(**kwargs)
