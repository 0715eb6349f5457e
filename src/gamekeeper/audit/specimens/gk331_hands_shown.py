"""Hands that are shown at once, played in turns: the last player sees those before it."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv

BREAKS = ("GK331",)
CONTRACT = {
    "api": "aec",
    "schedule": {"stages": [["player"]], "order": "none", "observe": "after tick"},
}
HANDS = 3


class Hands(AECEnv):
    """All show a hand; who shows one that nobody else does is paid its number."""

    metadata = {"name": "hands_v0", "render_modes": [], "is_parallelizable": False}  # noqa: RUF012

    def __init__(self, count: int = 3, rounds: int = 12, render_mode: str | None = None) -> None:
        super().__init__()
        self.count, self.rounds, self.render_mode = count, rounds, render_mode
        self.possible_agents = [f"player_{i}" for i in range(count)]
        self.agents: list[str] = []
        size = count + 1
        self._seen = {
            a: spaces.Box(0, max(HANDS, rounds), (size,), np.float32) for a in self.possible_agents
        }
        self._done = {a: spaces.Discrete(HANDS) for a in self.possible_agents}

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """No hands are shown; nothing is drawn."""
        self.agents = list(self.possible_agents)
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: dict[str, Any] = {a: {} for a in self.agents}
        self._skip_agent_selection = None
        self.shown = dict.fromkeys(self.agents, HANDS)
        self.chosen: dict[str, int] = {}
        self.time = 0
        self.agent_selection = self.agents[0]

    def observe(self, agent: str) -> Any:
        """The hands of all, the own one first, and the time."""
        names = sorted(self.possible_agents, key=lambda a: a != agent)
        return np.array([*(self.visible(a) for a in names), self.time], np.float32)

    def visible(self, agent: str) -> int:
        """The hand that others see: here the one of this very tick."""
        return self.chosen.get(agent, self.shown[agent])

    def step(self, action: Any) -> None:
        """One hand; after the last all are shown and paid."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        self.chosen[agent] = int(action)
        if len(self.chosen) == self.count:
            self.settle()
        place = self.possible_agents.index(agent)
        self.agent_selection = self.possible_agents[(place + 1) % self.count]
        self._accumulate_rewards()

    def settle(self) -> None:
        """Pays hands that stand alone."""
        self.shown, self.chosen = self.chosen, {}
        self.time += 1
        hands = list(self.shown.values())
        self.rewards = {
            a: float(hand) if hands.count(hand) == 1 else 0.0 for a, hand in self.shown.items()
        }
        if self.time >= self.rounds:
            self.truncations = dict.fromkeys(self.agents, True)

    def close(self) -> None:
        """Nothing is open."""


def make(**kwargs: Any) -> Hands:
    """The environment with its one fault."""
    return Hands(**kwargs)
