"""A clean AEC environment that pays seldom, and a faulty one."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv

from tests.faults import clean, faulty

RINGS = 20


@clean()
class Archers(AECEnv):
    """Archers shoot in turn, each at a ring of its own that moves, and are paid for a hit."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        "name": "archers_v0",
        "render_modes": [],
        "is_parallelizable": False,
    }

    def __init__(self, count: int = 3, rounds: int = 20, render_mode: str | None = None) -> None:
        super().__init__()
        self.rounds, self.render_mode = rounds, render_mode
        self.possible_agents = [f"archer_{i}" for i in range(count)]
        self.agents: list[str] = []
        self._seen = {a: spaces.Box(0.0, 1.0, (3,), np.float32) for a in self.possible_agents}
        self._done = {a: spaces.Discrete(RINGS) for a in self.possible_agents}
        self.rng: Any = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Hangs a ring for each."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: dict[str, Any] = {a: {} for a in self.agents}
        self._skip_agent_selection = None
        self.rings = {a: int(self.rng.integers(RINGS)) for a in self.agents}
        self.shots = dict.fromkeys(self.agents, 0)
        self.turn = 0
        self.agent_selection = self.agents[0]

    def step(self, action: Any) -> None:
        """One shot."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        self.turn += 1
        self.shots[agent] = int(action)
        following = self.agents[self.turn % len(self.agents)]
        self.rewards[self.paid(agent, following)] = float(int(action) == self.rings[agent])
        self.rings[agent] = int(self.rng.integers(RINGS))
        self.agent_selection = following
        if self.turn >= self.rounds * len(self.agents):
            self.truncations = dict.fromkeys(self.agents, True)
        self._accumulate_rewards()

    def paid(self, agent: str, following: str) -> str:
        """The archer that is paid for a shot."""
        return agent

    def observe(self, agent: str) -> Any:
        """The own ring, the own last shot, the time."""
        time = self.turn / (self.rounds * len(self.possible_agents))
        return np.array([self.rings[agent] / RINGS, self.shots[agent] / RINGS, time], np.float32)

    def close(self) -> None:
        """Nothing is open."""


@faulty("GK416", budget=3_000)
class PaidToTheSelected(Archers):
    """The agent that is in turn once the shot is over is paid for it.

    Archers shoot in turn.
    """

    def paid(self, agent: str, following: str) -> str:
        """What agent_selection has become."""
        return following
