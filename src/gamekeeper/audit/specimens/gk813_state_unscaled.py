"""The state is in cells, its space in parts of the torus."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK813",)


class StateUnscaled(Rovers):
    """A clean environment otherwise."""

    def state(self) -> Any:
        """Not divided by the size."""
        return super().state() * np.float32(5)


def make(**kwargs: Any) -> StateUnscaled:
    """The environment with its one fault."""
    return StateUnscaled(**kwargs)
