"""Environments that tests of adapters play: a guest comes late, or promises are broken."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import ParallelEnv

import gamekeeper as gk


class Late(gk.TickEnv):
    """A host of six ticks; a guest comes after two and leaves after five."""

    metadata = {"name": "late_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        self.possible_agents = ["host_0", "guest_0"]
        self.observation_spaces = {
            "host_0": Box(0, 6, (1,), np.float32),
            "guest_0": Box(0, 6, (2,), np.float32),
        }
        self.action_spaces = dict.fromkeys(self.possible_agents, Discrete(3))

    def starting_agents(self) -> list[str]:
        return ["host_0"]

    def start(self, rng: Any, options: Any) -> None:
        self.clock = 0

    def tick(self, actions: Any) -> None:
        self.clock += 1
        for agent, action in actions.items():
            self.add_reward(agent, float(action))
        if self.clock == 2:
            self.join("guest_0")
        if self.clock == 5:
            self.terminate("guest_0", "left")
        if self.clock == 6:
            self.truncate("host_0", "time")

    def observe(self, agent: Any) -> Any:
        return np.full(1 if agent == "host_0" else 2, self.clock, np.float32)


class Leaky(ParallelEnv):
    """Draws from the global generator, and shows what lies outside every promise."""

    metadata = {"name": "leaky_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self) -> None:
        self.possible_agents = ["a_0", "a_1"]
        self.render_mode = None

    def observation_space(self, agent: Any) -> Any:
        return Box(0, 1, (1,), np.float32)

    def action_space(self, agent: Any) -> Any:
        return Discrete(2)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.agents, self.left = list(self.possible_agents), 10
        return self._seen(), {a: {} for a in self.agents}

    def _seen(self) -> Any:
        return {a: np.random.random(1).astype(np.float32) * 3 for a in self.agents}  # the fault

    def step(self, actions: Any) -> Any:
        self.left -= 1
        agents = self.agents
        told = (
            self._seen(),
            dict.fromkeys(agents, 0.0),
            dict.fromkeys(agents, False),
            dict.fromkeys(agents, self.left == 0),
            {a: {} for a in agents},
        )
        if self.left == 0:
            self.agents = []
        return told
