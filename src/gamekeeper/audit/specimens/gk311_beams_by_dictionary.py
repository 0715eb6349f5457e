"""Beams are resolved in the order of the action dictionary: who is hit first doesn't fire any more.

Source: Sequential Social Dilemma Games, Cleanup and Harvest, whose `update_custom_moves` goes
through the dictionary that the caller handed over; rebuilt small.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

BREAKS = ("GK311",)
SIZE = 5
TURNS = ((0, 1), (1, 0), (0, -1), (-1, 0))
STAY, AHEAD, LEFT, RIGHT, FIRE = range(5)
REACH = 4


class Beams(ParallelEnv):
    """Gardeners walk over a torus, eat apples, and stun each other with beams."""

    metadata = {"name": "beams_v0", "render_modes": [], "is_parallelizable": True}  # noqa: RUF012

    def __init__(self, count: int = 6, horizon: int = 50, render_mode: str | None = None) -> None:
        self.count, self.horizon, self.render_mode = count, horizon, render_mode
        self.possible_agents = [f"gardener_{i}" for i in range(count)]
        self.agents: list[str] = []
        size = 4 * count + SIZE * SIZE
        self._seen = {a: spaces.Box(-1, SIZE, (size,), np.float32) for a in self.possible_agents}
        self._done = {a: spaces.Discrete(5) for a in self.possible_agents}
        self.rng: Any = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Places gardeners and apples."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.time = 0
        self.cells = {a: tuple(self.rng.integers(SIZE, size=2).tolist()) for a in self.agents}
        self.facing = {a: int(self.rng.integers(4)) for a in self.agents}
        self.stunned = dict.fromkeys(self.agents, 0)
        self.apples = self.rng.random((SIZE, SIZE)) < 0.2
        return {a: self.observation(a) for a in self.agents}, {a: {} for a in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        """All walk, then the beams: here the order of the dictionary decides."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        self.time += 1
        rewards = dict.fromkeys(self.agents, 0.0)
        able = {a: self.stunned[a] == 0 for a in self.agents}
        self.stunned = {a: max(n - 1, 0) for a, n in self.stunned.items()}
        for agent in self.agents:
            if able[agent]:
                self.walk(agent, int(actions[agent]))
                rewards[agent] += self.eat(agent)
        for agent in self.firing_order(actions):
            if able[agent] and int(actions[agent]) == FIRE and not self.stunned[agent]:
                for other in self.hit_by(agent):
                    self.stunned[other] = 3
                    rewards[other] -= 1.0
        self.apples |= self.rng.random((SIZE, SIZE)) < 0.02
        over = self.time >= self.horizon
        acting, self.agents = self.agents, [] if over else self.agents
        ended = dict.fromkeys(acting, False), dict.fromkeys(acting, over)
        seen = {a: self.observation(a) for a in acting}
        return seen, rewards, *ended, {a: {} for a in acting}

    def firing_order(self, actions: dict[str, Any]) -> list[str]:
        """Who fires before whom."""
        return list(actions)

    def walk(self, agent: str, action: int) -> None:
        """A step ahead, or a turn."""
        if action in (LEFT, RIGHT):
            self.facing[agent] = (self.facing[agent] + (1 if action == RIGHT else -1)) % 4
        elif action == AHEAD:
            (row, column), (down, right) = self.cells[agent], TURNS[self.facing[agent]]
            self.cells[agent] = ((row + down) % SIZE, (column + right) % SIZE)

    def eat(self, agent: str) -> float:
        """1 for an apple on the gardener's cell."""
        is_there = bool(self.apples[self.cells[agent]])
        self.apples[self.cells[agent]] = False
        return float(is_there)

    def hit_by(self, agent: str) -> list[str]:
        """Who stands in the beam."""
        (row, column), (down, right) = self.cells[agent], TURNS[self.facing[agent]]
        beam = {((row + k * down) % SIZE, (column + k * right) % SIZE) for k in range(1, REACH + 1)}
        return [a for a in self.agents if a != agent and self.cells[a] in beam]

    def observation(self, agent: str) -> Any:
        """The own row first, then those of all, and the apples."""
        rows = [
            [*self.cells[a], self.facing[a], self.stunned[a]]
            for a in sorted(self.possible_agents, key=lambda a: a != agent)
        ]
        return np.concatenate([np.ravel(rows), self.apples.ravel()]).astype(np.float32)

    def close(self) -> None:
        """Nothing is open."""


def make(**kwargs: Any) -> Beams:
    """The environment with its one fault."""
    return Beams(**kwargs)
