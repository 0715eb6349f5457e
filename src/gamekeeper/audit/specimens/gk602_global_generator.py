"""Every second round a trader that numpy's global generator draws is given a coin."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK602",)
ALSO = ("GK901",)
"""What was recorded can't be played again, as nobody recorded who else drew."""


class GlobalGenerator(Traders):
    """Luck hangs on whoever else draws in the process."""

    def settle(self) -> None:
        """A coin in every second round."""
        super().settle()
        if self.round % 2 == 0:
            winner = self.possible_agents[np.random.randint(self.count)]
            self.money[winner] += 1


def make(**kwargs: Any) -> GlobalGenerator:
    """The environment with its one fault."""
    return GlobalGenerator(**kwargs)
