"""A clean Parallel environment that faulty ones inherit from: rovers, samples, wind.

Rovers drive over a small torus and collect samples. A rover whose battery is empty terminates; what
is left at the horizon truncates. The wind sometimes keeps a rover where it is.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from tests.faults import clean

SIZE = 5
MOVES = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))


@clean()
class Rovers(ParallelEnv):
    """Rovers collect samples until their batteries are empty."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        "name": "rovers_v0",
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(self, count: int = 3, horizon: int = 20, render_mode: str | None = None) -> None:
        self.count, self.horizon, self.render_mode = count, horizon, render_mode
        self.possible_agents = [f"rover_{i}" for i in range(count)]
        self.agents: list[str] = []
        width = 2 * count + 3
        self._seen = {a: spaces.Box(0.0, 1.0, (width,), np.float32) for a in self.possible_agents}
        self._done = {a: spaces.Discrete(len(MOVES)) for a in self.possible_agents}
        self.state_space = spaces.Box(0.0, 1.0, (4 * count,), np.float32)
        self.rng: Any = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Places rovers and samples."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.time = 0
        self.cells = {a: self.rng.integers(SIZE, size=2) for a in self.agents}
        self.samples = {a: self.rng.integers(SIZE, size=2) for a in self.agents}
        self.battery = {a: int(self.rng.integers(8, 30)) for a in self.agents}
        return {a: self.observation(a) for a in self.agents}, {a: self.info(a) for a in self.agents}

    def step(self, actions: dict[str, Any]) -> Any:
        """All rovers drive at once."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        acting = list(self.agents)
        self.time += 1
        for agent in acting:
            self.drive(agent, int(actions[agent]))
        rewards = {a: self.reward(a) for a in acting}
        terminations = {a: self.battery[a] <= 0 for a in acting}
        late = self.time >= self.horizon
        truncations = {a: late and not terminations[a] for a in acting}
        self.agents = [a for a in acting if not (terminations[a] or truncations[a])]
        observations = {a: self.observation(a) for a in acting}
        return observations, rewards, terminations, truncations, {a: self.info(a) for a in acting}

    def drive(self, agent: str, action: int) -> None:
        """One rover's move; the wind may hold it."""
        if self.rng.random() >= 0.1:
            self.cells[agent] = (self.cells[agent] + MOVES[action]) % SIZE
        self.battery[agent] -= 1

    def reward(self, agent: str) -> float:
        """1 for a sample, which is then found elsewhere."""
        if not np.array_equal(self.cells[agent], self.samples[agent]):
            return 0.0
        self.samples[agent] = self.rng.integers(SIZE, size=2)
        return 1.0

    def observation(self, agent: str) -> Any:
        """All cells, the own sample and battery."""
        cells = [self.cells[a] / SIZE for a in self.possible_agents]
        own = [*(self.samples[agent] / SIZE), max(self.battery[agent], 0) / 30]
        return np.concatenate([*cells, own]).astype(np.float32)

    def info(self, agent: str) -> dict[str, Any]:
        """What is left in the battery."""
        return {"battery": self.battery[agent]}

    def state(self) -> Any:
        """Cells and samples of all."""
        parts = [self.cells[a] / SIZE for a in self.possible_agents]
        parts += [self.samples[a] / SIZE for a in self.possible_agents]
        return np.concatenate(parts).astype(np.float32)

    def render(self) -> Any:
        """A pixel field."""
        if self.render_mode is None:
            return None
        frame = np.zeros((SIZE * 4, SIZE * 4, 3), np.uint8)
        for agent in self.agents:
            row, column = self.cells[agent] * 4
            frame[row : row + 4, column : column + 4] = 220
        return frame

    def close(self) -> None:
        """Nothing is open."""


@clean()
class LongRovers(Rovers):
    """Rovers whose batteries last, so that an episode is long.

    Two hundred ticks for everybody.
    """

    def __init__(self, count: int = 2, horizon: int = 200, render_mode: str | None = None) -> None:
        super().__init__(count, horizon, render_mode)

    def drive(self, agent: str, action: int) -> None:
        """A move that costs nothing."""
        super().drive(agent, action)
        self.battery[agent] += 1
