"""One reward in some is drawn from numpy's global generator."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK602",)


class GlobalGenerator(Traders):
    """Ties in the fourth round are broken by the generator of the whole process."""

    def settle(self) -> None:
        """Luck comes from elsewhere in every second round."""
        super().settle()
        if self.round % 2 == 0:
            winner = self.possible_agents[np.random.randint(self.count)]
            self.money[winner] += 1


def make(**kwargs: Any) -> GlobalGenerator:
    """The environment with its one fault."""
    return GlobalGenerator(**kwargs)
