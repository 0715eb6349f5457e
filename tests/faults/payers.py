"""What an agent is paid for: its own move, and not another's."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from tests.faults import clean, faulty

LANE_CONTRACT = {
    "api": "parallel",
    "roles": {"driver": {"noop": 0}},
    "rewards": {"bump": {"kind": "individual", "earner": "driver", "payee": "earner"}},
}
SIZE = 6
MOVES = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))


@faulty("GK411")
class Pursuit(ParallelEnv):
    """Pursuers are paid for touching evaders before they move: every reward comes one step late.

    Source: the pursuit environment of MADRL (Gupta, Egorov & Kochenderfer 2017), whose step
    computes `rewards` before `agent_layer.move_agent`; rebuilt small.

    Pursuers on a torus chase evaders that drift about; touching and nearness pay.
    """

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        "name": "pursuit_v0",
        "render_modes": [],
        "is_parallelizable": True,
    }

    def __init__(self, count: int = 3, horizon: int = 30, render_mode: str | None = None) -> None:
        self.count, self.horizon, self.render_mode = count, horizon, render_mode
        self.possible_agents = [f"pursuer_{i}" for i in range(count)]
        self.agents: list[str] = []
        size = 2 * (2 * count)
        self._seen = {a: spaces.Box(0, SIZE, (size,), np.float32) for a in self.possible_agents}
        self._done = {a: spaces.Discrete(5) for a in self.possible_agents}
        self.rng: Any = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Places pursuers and evaders."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.time = 0
        self.cells = {a: self.rng.integers(SIZE, size=2) for a in self.agents}
        self.evaders = self.rng.integers(SIZE, size=(self.count, 2))
        return {a: self.observation(a) for a in self.agents}, {a: {} for a in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        """Pays, and moves everybody afterwards."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        self.time += 1
        rewards = {a: self.reward(a) for a in self.agents}
        for agent in self.agents:
            self.cells[agent] = (self.cells[agent] + MOVES[int(actions[agent])]) % SIZE
        self.evaders = (self.evaders + self.rng.integers(-1, 2, size=(self.count, 2))) % SIZE
        over = self.time >= self.horizon
        acting, self.agents = self.agents, [] if over else self.agents
        ended = dict.fromkeys(acting, False), dict.fromkeys(acting, over)
        seen = {a: self.observation(a) for a in acting}
        return seen, rewards, *ended, {a: {} for a in acting}

    def reward(self, agent: str) -> float:
        """1 for every evader on the own cell, and a little for the distance to the nearest."""
        apart = np.abs(self.evaders - self.cells[agent])
        steps = np.minimum(apart, SIZE - apart).sum(axis=1)
        return float((steps == 0).sum()) - 0.1 * float(steps.min())

    def observation(self, agent: str) -> Any:
        """The own cell, those of the others, the evaders."""
        names = sorted(self.possible_agents, key=lambda a: a != agent)
        cells = [*(self.cells[a] for a in names), *self.evaders]
        return np.concatenate(cells).astype(np.float32)

    def close(self) -> None:
        """Nothing is open."""


@faulty("GK421", contract=LANE_CONTRACT)
class Lane(ParallelEnv):
    """The penalty of a bump lands on who was bumped into, not on who drove.

    Drivers on a ring drive ahead by 0, 1 or 2 cells; who would hit a standing one bumps.
    """

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        "name": "lane_v0",
        "render_modes": [],
        "is_parallelizable": True,
    }

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


@clean(
    contract={
        **LANE_CONTRACT,
        "roles": {"driver": {"noop": 0, "symmetric": True}},
        "schedule": {"order": "none", "conflicts": "joint rule", "horizon": 15},
    }
)
class FairLane(Lane):
    """A clean environment: who drives into another pays for it, as its contract declares.

    Who drives pays.
    """

    def who_pays(self, driver: str, hit: str) -> str:
        """The driver."""
        return driver
