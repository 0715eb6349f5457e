"""The last rover observes NaN: the mean over no others."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK215",)


class Lonely(Rovers):
    """Where the others are, on average."""

    def observation(self, agent: str) -> Any:
        """The first two numbers are the mean of the others."""
        seen = super().observation(agent)
        others = [self.cells[a] / 5 for a in self.agents if a != agent]
        with np.errstate(all="ignore"):
            seen[:2] = np.array(others).reshape(-1, 2).sum(axis=0) / np.float64(len(others))
        return seen


def make(**kwargs: Any) -> Lonely:
    """The environment with its one fault."""
    return Lonely(**kwargs)
