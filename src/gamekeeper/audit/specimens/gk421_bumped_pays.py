"""The penalty of a bump lands on who was bumped into, not on who drove."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

BREAKS = ("GK421",)
CONTRACT = {
    "api": "parallel",
    "roles": {"driver": {"noop": 0}},
    "rewards": {"bump": {"kind": "individual", "earner": "driver", "payee": "earner"}},
}


class Lane(ParallelEnv):
    """Drivers on a ring drive ahead by 0, 1 or 2 cells; who would hit a standing one bumps."""

    metadata = {"name": "lane_v0", "render_modes": [], "is_parallelizable": True}  # noqa: RUF012

    def __init__(self, count: int = 3, horizon: int = 15, render_mode: str | None = None) -> None:
        self.count, self.horizon, self.render_mode = count, horizon, render_mode
        self.cells = 2 * count + 1
        self.possible_agents = [f"driver_{i}" for i in range(count)]
        self.agents: list[str] = []
        self._seen = {
            a: spaces.Box(0, self.cells, (count,), np.float32) for a in self.possible_agents
        }
        self._done = {a: spaces.Discrete(3) for a in self.possible_agents}
        self.rng: Any = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Every driver on a cell of its own."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.time = 0
        drawn = self.rng.permutation(self.cells)[: self.count].tolist()
        self.at = dict(zip(self.agents, drawn, strict=True))
        return {a: self.observation(a) for a in self.agents}, {a: {} for a in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        """Whose way was taken at the tick's start stays, and pays or has another pay."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        self.time += 1
        rewards = dict.fromkeys(self.agents, 0.0)
        stood = {cell: a for a, cell in self.at.items()}
        wanted = {}
        for agent in self.agents:
            way = [(self.at[agent] + k) % self.cells for k in range(1, int(actions[agent]) + 1)]
            hit = next((stood[cell] for cell in way if cell in stood), None)
            if hit is not None:
                rewards[self.who_pays(agent, hit)] -= 1.0
            wanted[agent] = self.at[agent] if hit is not None or not way else way[-1]
        targets = list(wanted.values())
        self.at = {a: c if targets.count(c) == 1 else self.at[a] for a, c in wanted.items()}
        over = self.time >= self.horizon
        acting, self.agents = self.agents, [] if over else self.agents
        ended = dict.fromkeys(acting, False), dict.fromkeys(acting, over)
        seen = {a: self.observation(a) for a in acting}
        return seen, rewards, *ended, {a: {} for a in acting}

    def who_pays(self, driver: str, hit: str) -> str:
        """Here it is who was hit."""
        return hit

    def observation(self, agent: str) -> Any:
        """The cells of all, the own one first."""
        names = sorted(self.possible_agents, key=lambda a: a != agent)
        return np.array([self.at[a] for a in names], np.float32)

    def close(self) -> None:
        """Nothing is open."""


def make(**kwargs: Any) -> Lane:
    """The environment with its one fault."""
    return Lane(**kwargs)
