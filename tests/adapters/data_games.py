"""A game with what data sets tend to lose: late joins, deaths, masks, pictures, odd values."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete, Text
from pettingzoo import ParallelEnv

import gamekeeper as gk
from gamekeeper.contract import Contract, RewardTerm

DAY, NIGHT, SPARE = "day_0", "night_0", "spare_0"
LAST = 6


class Shift(ParallelEnv):
    """`day_0` is terminated at tick 3, `spare_0` joins at 2, all others are truncated at 6."""

    metadata = {"name": "shift_v0", "render_modes": ["ansi"]}  # noqa: RUF012  # PettingZoo's way

    def __init__(self, nonconforming: str = "", render_mode: str | None = None) -> None:
        self.nonconforming, self.render_mode = nonconforming, render_mode
        self.possible_agents = [NIGHT, DAY, SPARE]
        picture = Box(0, 255, (40, 32, 3), np.uint8)
        self.observation_spaces = {
            DAY: Box(-1e9, 1e9, (4,), np.float32),
            NIGHT: Dict({"picture": picture, "word": Text(5), "count": Discrete(50, start=3)}),
            SPARE: Box(-1e9, 1e9, (4,), np.float32),
        }
        self.action_spaces = {
            DAY: Discrete(3),
            NIGHT: MultiDiscrete([2, 5]),
            SPARE: Discrete(3, start=1),
        }

    def observation_space(self, agent: str) -> Any:
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.rng = np.random.Generator(np.random.PCG64(seed or 0))
        self.tick, self.agents = 0, [NIGHT, DAY]
        return self._seen(self.agents), self._told(self.agents)

    def step(self, actions: dict[str, Any]) -> Any:
        self.tick += 1
        there = list(self.agents)
        if self.tick == 2:
            there.append(SPARE)
        terms = {agent: agent == DAY and self.tick == 3 for agent in there}
        truncs = {agent: agent != DAY and self.tick == LAST for agent in there}
        rewards = {agent: float(self.tick + len(agent)) for agent in there}
        self.agents = [agent for agent in there if not (terms[agent] or truncs[agent])]
        return self._seen(there), rewards, terms, truncs, self._told(there)

    def state(self) -> Any:
        return np.array([self.tick, 2 * self.tick], np.float32)

    def render(self) -> str:
        return f"tick {self.tick}"

    def close(self) -> None:
        pass

    def _seen(self, agents: list[str]) -> dict[str, Any]:
        numbers = self.rng.normal(size=4).astype(np.float32)
        if self.nonconforming == "observation" and self.tick == 1:
            numbers = numbers.astype(np.float64)
        picture = self.rng.integers(0, 256, (40, 32, 3), np.uint8)
        night = {"picture": picture, "word": f"tick{self.tick}", "count": 3 + self.tick}
        return {agent: night if agent == NIGHT else numbers.copy() for agent in agents}

    def _told(self, agents: list[str]) -> dict[str, Any]:
        mask = np.array([1, self.tick % 2, 1], np.int8)
        told: dict[str, Any] = {agent: {"tick": self.tick} for agent in agents}
        if DAY in told:
            told[DAY]["action_mask"] = mask
        return told


def rows_of(evidence: Any, agent: str) -> list[dict[str, Any]]:
    """The rows of one agent, as plain values."""
    return [row for row in evidence.agent_steps.to_pylist() if row["agent"] == agent]


def of_terms(**options: Any) -> Any:
    """Evidence of a game that pays without saying by which of the terms that its contract names."""
    terms = {name: RewardTerm(kind="individual") for name in ("care", "speed")}
    return gk.rollout(Shift, episodes=2, contract=Contract(rewards=terms), **options)
