"""The array in each rover's info is one that is written to at every step."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK611",)


class MaskUsedAgain(Rovers):
    """One array in all infos of a rover."""

    def info(self, agent: str) -> dict[str, Any]:
        """What is left in the battery, in an array."""
        if not hasattr(self, "gauges"):
            self.gauges = {a: np.zeros(1) for a in self.possible_agents}
        self.gauges[agent][0] = self.battery[agent]
        return {"battery": self.battery[agent], "gauge": self.gauges[agent]}


def make(**kwargs: Any) -> MaskUsedAgain:
    """The environment with its one fault."""
    return MaskUsedAgain(**kwargs)
