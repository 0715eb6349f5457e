"""There is no state once a rover has ended."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK818",)


class StateNeedsEverybody(Rovers):
    """A clean environment otherwise."""

    def state(self) -> Any:
        """Knows the cells of live rovers only."""
        cells = {agent: self.cells[agent] for agent in self.agents}
        rows = [cells[agent] / 5 for agent in self.possible_agents]
        rows += [self.samples[agent] / 5 for agent in self.possible_agents]
        return np.concatenate(rows).astype(np.float32)


def make(**kwargs: Any) -> StateNeedsEverybody:
    """The environment with its one fault."""
    return StateNeedsEverybody(**kwargs)
