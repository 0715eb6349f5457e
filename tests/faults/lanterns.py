"""A clean AEC environment in cycles that faulty ones inherit from: lanterns on a pier.

Keepers set their lanterns one after the other; what they set shows once all have, and a gust may
blow one out. Everybody is paid by how even the light is. After some rounds all are truncated. It
may be stepped as a Parallel environment, and says so.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv

from tests.faults import clean

LEVELS = 4


@clean()
class Lanterns(AECEnv):
    """Keepers set lanterns in turn; a round is settled when all have."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        "name": "lanterns_v0",
        "render_modes": [],
        "is_parallelizable": True,
    }

    def __init__(self, count: int = 3, rounds: int = 6, render_mode: str | None = None) -> None:
        super().__init__()
        self.count, self.rounds, self.render_mode = count, rounds, render_mode
        self.possible_agents = [f"keeper_{i}" for i in range(count)]
        self.agents: list[str] = []
        self._seen = {
            a: spaces.Box(0.0, 1.0, (count + 1,), np.float32) for a in self.possible_agents
        }
        self._done = {a: spaces.Discrete(LEVELS) for a in self.possible_agents}
        self.state_space = spaces.Box(0.0, 1.0, (count,), np.float32)
        self.rng: Any = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Lights the lanterns anyhow."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self._skip_agent_selection = None
        self.level = self.rng.integers(LEVELS, size=self.count).astype(np.float32)
        self.round = 0
        self.wanted: dict[str, int] = {}
        self.infos: dict[str, Any] = {a: self.info(a) for a in self.agents}
        self.agent_selection = self.agents[0]

    def step(self, action: Any) -> None:
        """One keeper's wish; the last one's settles the round."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        self.wanted[agent] = int(action)
        place = self.agents.index(agent) + 1
        if place == len(self.agents):
            self.settle()
        self.agent_selection = self.agents[place % len(self.agents)]
        self._accumulate_rewards()

    def settle(self) -> None:
        """What was wished shows, but for one lantern that a gust may blow out."""
        self.level[:] = [self.wanted[a] for a in self.possible_agents]
        gust = int(self.rng.integers(2 * self.count))
        if gust < self.count:
            self.level[gust] = 0.0
        self.wanted = {}
        self.round += 1
        for agent in self.agents:
            self.rewards[agent] = -float(np.ptp(self.level)) / LEVELS
            self.truncations[agent] = self.round >= self.rounds
            self.infos[agent] = self.info(agent)

    def info(self, agent: str) -> dict[str, Any]:
        """How far the own lantern is from each other."""
        own = self.possible_agents.index(agent)
        return {"gaps": self.level - self.level[own]}

    def observe(self, agent: str) -> Any:
        """All lanterns, and the round."""
        return np.array([*self.level / LEVELS, self.round / self.rounds], np.float32)

    def state(self) -> Any:
        """All lanterns."""
        return (self.level / LEVELS).astype(np.float32)

    def close(self) -> None:
        """Nothing is open."""
