"""Small Parallel games with numbers as agents' names, for edge cases of order and influence."""

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv


class Grab(ParallelEnv):
    """Who asks for the coin gets it; `rule` says how a conflict is settled.

    `rule`: `first` (in the dictionary), `draw` (among those who ask), `dice` (each draws in the
    order of the dictionary, the highest wins), `biased` (as dice, and the first adds a bit),
    `none` (nobody gets it).
    """

    metadata = {"name": "grab_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, rule: str = "none", agents: tuple[Any, ...] = (0, 1, 2), end: int = 8):
        self.rule, self.end = rule, end
        self.possible_agents = list(agents)
        self.agents: list[Any] = []
        self._seen = {a: spaces.Box(0, 100, (2,), np.float32) for a in agents}
        self._done = {a: spaces.Discrete(2) for a in agents}

    def observation_space(self, agent: Any) -> Any:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: Any) -> Any:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """No coins yet."""
        self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.coins = dict.fromkeys(self.agents, 0)
        self.time = 0
        return self._views(), {a: {} for a in self.agents}

    def step(self, actions: Any) -> Any:
        """One coin."""
        asking = [a for a in actions if actions[a] == 1]
        winner = self._winner(asking)
        self.time += 1
        rewards = {a: float(a == winner) for a in self.agents}
        if winner is not None:
            self.coins[winner] += 1
        over = self.time >= self.end
        out = (
            self._views(),
            rewards,
            dict.fromkeys(self.agents, False),
            dict.fromkeys(self.agents, over),
            {a: {} for a in self.agents},
        )
        self.agents = [] if over else self.agents
        return out

    def _winner(self, asking: list[Any]) -> Any:
        if not asking:
            return None
        if self.rule == "first":
            return asking[0]
        if self.rule == "draw":
            return sorted(asking, key=str)[int(self.rng.integers(len(asking)))]
        if self.rule in ("dice", "biased"):
            bonus = 0.5 if self.rule == "biased" else 0.0
            thrown = [self.rng.random() + bonus * (place == 0) for place in range(len(asking))]
            return asking[int(np.argmax(thrown))]
        return asking[0] if len(asking) == 1 else None

    def _views(self) -> Any:
        return {
            a: np.array([self.coins[a], sum(self.coins.values())], np.float32) for a in self.agents
        }

    def close(self) -> None:
        """Nothing is open."""


class Summed(Grab):
    """Adds floats up in the order of the dictionary, so only last digits depend on it."""

    def step(self, actions: Any) -> Any:
        """The reward is a sum of unequal parts."""
        out = super().step(dict.fromkeys(self.agents, 0))
        total = 0.0
        for agent in actions:
            total += 0.1 + 0.7 * self.possible_agents.index(agent)
        return out[0], dict.fromkeys(out[1], total), *out[2:]
