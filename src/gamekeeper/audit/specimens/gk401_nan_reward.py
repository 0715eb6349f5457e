"""A rover with little left in its battery is paid NaN."""

from __future__ import annotations

import math
from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK401",)


class NanReward(Rovers):
    """The reward is divided by nothing once."""

    def reward(self, agent: str) -> float:
        """NaN where the battery stands at 5."""
        reward = super().reward(agent)
        return math.nan if self.battery[agent] == 5 else reward


def make(**kwargs: Any) -> NanReward:
    """The environment with its one fault."""
    return NanReward(**kwargs)
