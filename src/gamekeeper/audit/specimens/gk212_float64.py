"""Observations are of float64, and the space says float32."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK212",)


class Doubles(Rovers):
    """Twice as long as declared."""

    def observation(self, agent: str) -> Any:
        """Without the last conversion."""
        return super().observation(agent).astype(np.float64)


def make(**kwargs: Any) -> Doubles:
    """The environment with its one fault."""
    return Doubles(**kwargs)
