"""state() draws its noise from the game's generator."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._lanterns import Lanterns

BREAKS = ("GK636",)
ALSO = ("GK814",)
"""Two looks at the state of one turn differ by the fog."""


class StateDraws(Lanterns):
    """Each look at the state draws."""

    def state(self) -> Any:
        """The lanterns, as one sees them in the fog."""
        fog = self.rng.normal(0.0, 0.01, self.count)
        return np.clip(super().state() + fog, 0.0, 1.0).astype(np.float32)


def make(**kwargs: Any) -> StateDraws:
    """The environment with its one fault."""
    return StateDraws(**kwargs)
