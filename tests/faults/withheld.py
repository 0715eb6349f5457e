"""Rewards that are held back, or lost where an episode is truncated."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.faults import clean, faulty
from tests.faults.rovers import Rovers


@clean()
class Tolls(Rovers):
    """Rovers that pay in each tick, the more the further away they are."""

    def reward(self, agent: str) -> float:
        """The distance to the sample, which stays where it is."""
        return -1.0 - float(np.abs(self.cells[agent] - self.samples[agent]).sum())


@faulty("GK412", budget=2_000)
class LostAtTheLimit(Tolls):
    """Nobody pays in the tick that truncates.

    It returns early, with rewards that were never computed.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Rewards of 0 beside truncations."""
        observations, rewards, terminations, truncations, infos = super().step(actions)
        if any(truncations.values()):
            rewards = dict.fromkeys(rewards, 0.0)
        return observations, rewards, terminations, truncations, infos


@faulty("GK413", budget=2_000)
class HeldBack(Tolls):
    """Every reward is paid two ticks later, and the last two never are.

    A queue that is filled at one end and emptied at the other.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The queue begins with nothing for two ticks."""
        self.due: list[dict[str, float]] = [{}, {}]
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Pays what was due two ticks ago."""
        observations, rewards, *rest = super().step(actions)
        self.due.append(rewards)
        due = self.due.pop(0)
        return observations, {agent: due.get(agent, 0.0) for agent in rewards}, *rest
