"""The wind comes from the system's entropy."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK601",)


class Entropy(Rovers):
    """The seed settles where rovers start, and not how far they come."""

    battery: dict[str, Any]

    def drive(self, agent: str, action: int) -> None:
        """Headwind costs more."""
        super().drive(agent, action)
        self.battery[agent] -= np.random.default_rng().random()


def make(**kwargs: Any) -> Entropy:
    """The environment with its one fault."""
    return Entropy(**kwargs)
