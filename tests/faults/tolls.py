"""Rewards held back or lost by a truncation, observations of another agent or moment."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from tests.faults import clean, faulty
from tests.faults.rovers import Rovers


@clean()
class Tolls(Rovers):
    """Rovers that pay in each tick, the more the further away they are.

    They observe their own number too, and an option says what a tick costs.
    """

    toll = 1.0

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        size = self._seen[self.possible_agents[0]].shape[0] + 1
        self._seen = {a: spaces.Box(0.0, 1.0, (size,), np.float32) for a in self.possible_agents}

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The option holds for the episode."""
        self.toll = float((options or {}).get("toll", type(self).toll))
        return super().reset(seed, options)

    def reward(self, agent: str) -> float:
        """The distance to the sample, which stays where it is."""
        return -self.toll - float(np.abs(self.cells[agent] - self.samples[agent]).sum())

    def observation(self, agent: str) -> Any:
        """The number stands last."""
        number = self.possible_agents.index(agent) / len(self.possible_agents)
        return np.append(super().observation(agent), number).astype(np.float32)


@faulty("GK412", budget=1_500)
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


@faulty("GK413", budget=1_500)
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


@faulty("GK217", budget=1_500)
class OfTheLastOne(Tolls):
    """Each step gives all rovers what the last of them observes.

    A function that is made in a loop, and asks for the loop's rover when it is called.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Observations of the last one."""
        observations, *rest = super().step(actions)
        last = next(reversed(observations), None)
        return {agent: observations[last].copy() for agent in observations}, *rest


@faulty("GK218", budget=1_500)
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
