"""The wind comes from the system's entropy."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK601",)


class Entropy(Rovers):
    """The seed settles where rovers start, and not how they drive."""

    def drive(self, agent: str, action: int) -> None:
        """The wind turns the battery down at random."""
        super().drive(agent, action)
        self.battery[agent] -= int(np.random.default_rng().integers(2))


def make(**kwargs: Any) -> Entropy:
    """The environment with its one fault."""
    return Entropy(**kwargs)
