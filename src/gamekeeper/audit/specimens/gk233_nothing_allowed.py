"""A player who is left with two cells is allowed none of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._tokens import CELLS, Tokens

BREAKS = ("GK233",)


class NothingAllowed(Tokens):
    """Two cells are thought to be of no use, and whatever is done then is taken for the first."""

    def observe(self, agent: str) -> dict[str, Any]:
        """Nothing is allowed where two cells are left."""
        seen = super().observe(agent)
        if self.legal().sum() <= 2:
            seen["action_mask"] = np.zeros(CELLS, np.int8)
        return seen

    def step(self, action: Any) -> None:
        """Takes any action where the mask allowed none."""
        if action is not None and 0 < self.legal().sum() <= 2:
            action = int(np.argmax(self.legal()))
        super().step(action)


def make(**kwargs: Any) -> NothingAllowed:
    """The environment with its one fault."""
    return NothingAllowed(**kwargs)
