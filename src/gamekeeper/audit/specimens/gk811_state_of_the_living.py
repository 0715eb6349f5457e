"""The state has rows for live rovers only."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK811",)


class StateOfTheLiving(Rovers):
    """A clean environment otherwise."""

    def state(self) -> Any:
        """Shorter whenever a rover has ended."""
        rows = [self.cells[a] / 5 for a in self.agents] + [self.samples[a] / 5 for a in self.agents]
        return np.concatenate(rows or [np.zeros(0)]).astype(np.float32)


def make(**kwargs: Any) -> StateOfTheLiving:
    """The environment with its one fault."""
    return StateOfTheLiving(**kwargs)
