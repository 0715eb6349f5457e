"""A clean AEC environment that faulty ones inherit from: traders who go bankrupt.

Traders bid one after the other for a lot; the highest bid wins it once all have bid. A trader
without money terminates; who is left after the last round truncates. The opening trader rotates.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv

from tests.faults import clean

BIDS = 4


@clean()
class Traders(AECEnv):
    """Traders bid in turn until their money or the rounds are gone."""

    metadata = {  # noqa: RUF012  # as PettingZoo has it
        "name": "traders_v0",
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "is_parallelizable": False,
    }

    def __init__(self, count: int = 3, rounds: int = 8, render_mode: str | None = None) -> None:
        super().__init__()
        self.count, self.rounds, self.render_mode = count, rounds, render_mode
        self.possible_agents = [f"trader_{i}" for i in range(count)]
        self.agents: list[str] = []
        self._seen = {
            a: spaces.Box(0.0, 1.0, (count + 3,), np.float32) for a in self.possible_agents
        }
        self._done = {a: spaces.Discrete(BIDS) for a in self.possible_agents}
        self.state_space = spaces.Box(0.0, 1.0, (count + 2,), np.float32)
        self.rng: Any = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Hands out money."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: dict[str, Any] = {a: {} for a in self.agents}
        self._skip_agent_selection = None
        self.money = {a: int(self.rng.integers(4, 12)) for a in self.agents}
        self.round = 0
        self.open_round()

    def open_round(self) -> None:
        """A new lot, and a queue that begins with another trader each round."""
        live = [a for a in self.agents if not (self.terminations[a] or self.truncations[a])]
        self.lot = int(self.rng.integers(1, BIDS))
        self.bids: dict[str, int] = {}
        start = self.round % len(live) if live else 0
        self.queue = live[start:] + live[:start]
        if live:
            self.agent_selection = self.queue[0]

    def step(self, action: Any) -> None:
        """One trader's bid."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        self.bids[agent] = min(int(action), self.money[agent])
        self.queue = self.queue[1:]
        if self.queue:
            self.agent_selection = self.queue[0]
        else:
            self.settle()
        self._accumulate_rewards()
        self._deads_step_first()

    def settle(self) -> None:
        """The highest bid, drawn among equals, wins the lot; everybody pays rent."""
        best = [a for a in self.bids if self.bids[a] == max(self.bids.values())]
        winner = best[int(self.rng.integers(len(best)))]
        self.money[winner] += self.lot - self.bids[winner]
        self.rewards[winner] = float(self.lot - self.bids[winner])
        self.round += 1
        for agent in self.bids:
            self.money[agent] -= 1
            self.infos[agent] = {"won": agent == winner}
            if self.money[agent] <= 0:
                self.terminations[agent] = True
                self.rewards[agent] -= 1.0
            elif self.round >= self.rounds:
                self.truncations[agent] = True
        self.open_round()

    def observe(self, agent: str) -> Any:
        """Everybody's money, the own, the lot, the round."""
        purses = [max(self.money[a], 0) / 40 for a in self.possible_agents]
        own = [max(self.money[agent], 0) / 40, self.lot / BIDS, self.round / self.rounds]
        return np.array([*purses, *own], np.float32)

    def state(self) -> Any:
        """Everybody's money, the lot, the round."""
        purses = [max(self.money[a], 0) / 40 for a in self.possible_agents]
        return np.array([*purses, self.lot / BIDS, self.round / self.rounds], np.float32)

    def render(self) -> Any:
        """A bar for each purse."""
        if self.render_mode is None:
            return None
        frame = np.zeros((16, 4 * self.count, 3), np.uint8)
        for place, agent in enumerate(self.possible_agents):
            frame[16 - max(min(self.money[agent], 15), 0) :, 4 * place : 4 * place + 3] = 200
        return frame

    def close(self) -> None:
        """Nothing is open."""


@clean()
class FarTraders(Traders):
    """Traders who are given money again and again, so that an episode is long.

    A limit of thousands of cycles, which no rollout meets.
    """

    def __init__(self, max_cycles: int = 5000, render_mode: str | None = None) -> None:
        super().__init__(2, max_cycles, render_mode)

    def settle(self) -> None:
        """Nobody goes bankrupt."""
        self.money = dict.fromkeys(self.bids, 20)
        super().settle()
