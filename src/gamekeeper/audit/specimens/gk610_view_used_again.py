"""An observation is written into the array that its trader was given before."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK610",)


class ViewUsedAgain(Traders):
    """One array for each trader, at every turn."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """An array for each trader."""
        super().reset(seed, options)
        self.views = {a: np.zeros(self.count + 3, np.float32) for a in self.possible_agents}

    def observe(self, agent: str) -> Any:
        """The trader's own array, written anew."""
        self.views[agent][:] = super().observe(agent)
        return self.views[agent]


def make(**kwargs: Any) -> ViewUsedAgain:
    """The environment with its one fault."""
    return ViewUsedAgain(**kwargs)
