"""state() writes into the array that it gave before."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK612",)


class StateUsedAgain(Rovers):
    """One array for all states."""

    def state(self) -> Any:
        """The same array, written anew."""
        if not hasattr(self, "whole"):
            self.whole = np.zeros(4 * self.count, np.float32)
        self.whole[:] = super().state()
        return self.whole


def make(**kwargs: Any) -> StateUsedAgain:
    """The environment with its one fault."""
    return StateUsedAgain(**kwargs)
