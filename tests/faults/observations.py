"""Observations of another agent, and of another moment."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from tests.faults import clean, faulty
from tests.faults.rovers import Rovers
from tests.faults.withheld import Tolls


@clean()
class Numbered(Rovers):
    """Rovers that observe their own number too."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        size = self._seen[self.possible_agents[0]].shape[0] + 1
        self._seen = {a: spaces.Box(0.0, 1.0, (size,), np.float32) for a in self.possible_agents}

    def observation(self, agent: str) -> Any:
        """The number stands last."""
        number = self.possible_agents.index(agent) / len(self.possible_agents)
        return np.append(super().observation(agent), number).astype(np.float32)


@faulty("GK217", budget=2_000)
class OfTheLastOne(Numbered):
    """Each step gives all rovers what the last of them observes.

    A function that is made in a loop, and asks for the loop's rover when it is called.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Observations of the last one."""
        observations, *rest = super().step(actions)
        last = next(reversed(observations), None)
        return {agent: observations[last].copy() for agent in observations}, *rest


@faulty("GK218", budget=2_000)
class BeforeTheTick(Tolls):
    """Observations are made before the rovers drive.

    The last one of an episode is never seen.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Keeps the first observations for the first tick."""
        observations, infos = super().reset(seed, options)
        self.made = {agent: seen.copy() for agent, seen in observations.items()}
        return observations, infos

    def step(self, actions: dict[str, Any]) -> Any:
        """Gives what was made, and makes the next."""
        observations, *rest = super().step(actions)
        made, self.made = self.made, observations
        return {agent: made[agent].copy() for agent in observations}, *rest
