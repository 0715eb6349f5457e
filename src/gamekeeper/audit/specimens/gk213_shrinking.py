"""Observations shrink when a rover has left."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK213",)


class Shrinking(Rovers):
    """Those who are left see only each other."""

    def observation(self, agent: str) -> Any:
        """The cells of live rovers."""
        seen = super().observation(agent)
        gone = [i for i, a in enumerate(self.possible_agents) if a not in self.agents]
        return np.delete(seen, [2 * i + k for i in gone for k in (0, 1)])


def make(**kwargs: Any) -> Shrinking:
    """The environment with its one fault."""
    return Shrinking(**kwargs)
