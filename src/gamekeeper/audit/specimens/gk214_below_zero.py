"""An empty battery is charged below zero, outside the space."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK214",)


class BelowZero(Rovers):
    """Seen only at the end of a rover."""

    def drive(self, agent: str, action: int) -> None:
        """Driving into a sample costs three."""
        super().drive(agent, action)
        if np.array_equal(self.cells[agent], self.samples[agent]):
            self.battery[agent] -= 3

    def observation(self, agent: str) -> Any:
        """The battery as it is."""
        seen = super().observation(agent)
        seen[-1] = self.battery[agent] / 30
        return seen


def make(**kwargs: Any) -> BelowZero:
    """The environment with its one fault."""
    return BelowZero(**kwargs)
