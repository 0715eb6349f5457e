"""Walkers that fall off a beam one after another: whose rewards are whose."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from tests.faults import clean, faulty

EDGE = 2.2
"""Distance from the middle at which a walker falls."""


@clean()
class Walkers(ParallelEnv):
    """A clean environment: each walker is paid for its own distance, whoever has fallen before.

    Walkers step to either side, a gust moves them too, and who is too far from the middle leaves.
    """

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        "name": "walkers_v0",
        "render_modes": [],
        "is_parallelizable": True,
    }

    def __init__(self, count: int = 6, horizon: int = 24, render_mode: str | None = None) -> None:
        self.count, self.horizon, self.render_mode = count, horizon, render_mode
        self.possible_agents = [f"walker_{i}" for i in range(count)]
        self.agents: list[str] = []
        high = np.array([2 * EDGE + 2, horizon], np.float32)
        self._seen = {a: spaces.Box(-high, high, dtype=np.float32) for a in self.possible_agents}
        self._done = {a: spaces.Discrete(3) for a in self.possible_agents}
        self.rng: Any = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Walkers near the middle."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.time = 0
        self.at = self.rng.uniform(-1.0, 1.0, self.count)
        return {a: self.observation(a) for a in self.agents}, {a: {} for a in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        """All step at once."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        self.time += 1
        acting = self.agents
        for agent in acting:
            self.at[self.place(agent)] += 0.7 * (int(actions[agent]) - 1)
            self.at[self.place(agent)] += self.rng.uniform(-0.2, 0.2)
        fallen = {a: bool(abs(self.at[self.place(a)]) > EDGE) for a in acting}
        over = dict.fromkeys(acting, self.time >= self.horizon)
        self.agents = [a for a in acting if not (fallen[a] or over[a])]
        seen = {a: self.observation(a) for a in acting}
        return seen, self.paid(acting), fallen, over, {a: {} for a in acting}

    def place(self, agent: str) -> int:
        """Its place among all."""
        return self.possible_agents.index(agent)

    def paid(self, acting: list[str]) -> dict[str, float]:
        """Each walker's own distance from the middle."""
        return {a: -float(abs(self.at[self.place(a)])) for a in acting}

    def observation(self, agent: str) -> Any:
        """The own distance and the time."""
        return np.array([self.at[self.place(agent)], self.time], np.float32)

    def close(self) -> None:
        """Nothing is open."""


@faulty("GK415", budget=6_000)
class WalkersLaidOver(Walkers):
    """Rewards of all walkers are laid over those that are left.

    Numbers the walkers that are still there.
    """

    def paid(self, acting: list[str]) -> dict[str, float]:
        """By the place among those that act."""
        return {a: -float(abs(self.at[i])) for i, a in enumerate(acting)}
