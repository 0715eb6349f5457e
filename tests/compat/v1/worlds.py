"""The environments of the runs beside this file, as they were when these were recorded.

Never edited: a replay of the runs has to find here what played then. Their randomness is their
own arithmetic, so that no generator of a library stands between then and now.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

import gamekeeper as gk

MASK32 = 0xFFFFFFFF


class Dice:
    """Draws numbers from its seed (Numerical Recipes' linear congruential generator)."""

    def __init__(self, seed: int | None) -> None:
        self.value = (seed or 0) & MASK32

    def roll(self, sides: int) -> int:
        """An integer from 0 to `sides` - 1."""
        self.value = (1664525 * self.value + 1013904223) & MASK32
        return (self.value >> 16) % sides


def sight(picture: bool) -> spaces.Dict:
    """A seller sees the stall too."""
    parts: dict[str, spaces.Space[Any]] = {
        "near": spaces.Box(-np.inf, np.inf, (3,), np.float32),
        "price": spaces.Discrete(100, start=-50),
        "sign": spaces.Text(8, charset="abcäö日"),
    }
    if picture:
        parts["stall"] = spaces.Box(0, 255, (4, 4, 3), np.uint8)
    return spaces.Dict(parts)


class Market(ParallelEnv):
    """Parallel: nested observations by role, masks, nonconforming values, a late joiner."""

    metadata: ClassVar[dict[str, Any]] = {"name": "market_v1", "render_modes": ["rgb_array"]}

    def __init__(self, days: int = 6, fails: bool = False, render_mode: str | None = None) -> None:
        self.days, self.fails, self.render_mode = days, fails, render_mode
        self.possible_agents = ["seller_0", "buyer_0", "käufer/2"]
        self.observation_spaces = {a: sight(a == "seller_0") for a in self.possible_agents}
        self.action_spaces = {
            "seller_0": spaces.Dict({"ask": spaces.Box(0, 9, (2,), np.float64)}),
            "buyer_0": spaces.Discrete(4),
            "käufer/2": spaces.MultiDiscrete([3, 2]),
        }
        self.agents: list[str] = []

    def observation_space(self, agent: str) -> Any:
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        self.dice = Dice(seed)
        self.day, self.total = 0, float((options or {}).get("start", 0))
        self.agents = ["seller_0", "buyer_0"]
        return self.observations(), {agent: self.info(agent) for agent in self.agents}

    def observations(self) -> dict[str, Any]:
        return {agent: self.observation(agent) for agent in self.agents}

    def observation(self, agent: str) -> dict[str, Any]:
        near = np.array([self.dice.roll(7) / 8, -0.0, self.day], np.float32)
        if self.day == 2:
            near[0], near[1] = np.nan, np.inf
        if self.day == 4 and agent == "buyer_0":
            near = near.astype(np.float64)  # nonconforming: not the declared dtype
        seen = {
            "near": near, "price": np.int64(self.dice.roll(100) - 50),
            "sign": "aä日"[: self.dice.roll(4)],
        }  # fmt: skip
        if agent == "seller_0":
            seen["stall"] = np.full((4, 4, 3), self.dice.roll(256), np.uint8)
        return seen

    def info(self, agent: str) -> dict[str, Any]:
        if agent != "buyer_0":
            return {}
        mask = np.array([1, self.day % 2, 1, 0], np.int8)
        return {"action_mask": mask, "day": self.day, "told": {"by": "seller_0", "ok": True}}

    def state(self) -> Any:
        return np.array([self.day, self.total], np.float64)

    def step(self, actions: dict[str, Any]) -> Any:
        self.day += 1
        if self.fails and self.day == 4:
            raise RuntimeError("the market burned down")
        rewards: dict[str, Any] = {a: self.dice.roll(9) / 2 - 1 for a in self.agents}
        self.total += sum(rewards.values())
        if self.day == 3:
            rewards["buyer_0"] = np.array([0.5])  # nonconforming: no number
        if self.day == 2:
            self.agents = [*self.agents, "käufer/2"]  # joins late
        leaves = "käufer/2" if self.day == 5 else None  # leaves alone
        is_over = self.day >= self.days
        terminated = {agent: agent == leaves for agent in self.agents}
        truncated = dict.fromkeys(self.agents, is_over)
        seen = self.observations(), {agent: rewards.get(agent, 0.0) for agent in self.agents}
        infos = {agent: self.info(agent) for agent in self.agents}
        self.agents = [] if is_over else [a for a in self.agents if a != leaves]
        return *seen, terminated, truncated, infos

    def render(self) -> Any:
        return np.full((8, 8, 3), 30 * self.day, np.uint8)

    def close(self) -> None:
        self.agents = []


class Relay(gk.TurnEnv):
    """AEC: rewards by terms, a volatile info, our own stream of random numbers, an early end."""

    metadata: ClassVar[dict[str, Any]] = {"name": "relay_v1", "is_parallelizable": False}
    contract = "relay.toml"

    def __init__(self, length: int = 9, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        self.length = length
        self.possible_agents = ["runner_0", "runner_1", "runner_2"]
        self.observation_spaces = {
            agent: spaces.Box(-1.0, 99.0, (2,), np.float64) for agent in self.possible_agents
        }
        self.action_spaces = {agent: spaces.Discrete(3) for agent in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        self.rng = rng
        self.wind, self.turn, self.place = rng.uniform(), 0, 0

    def act(self, agent: str, action: int) -> None:
        self.turn += 1
        self.place += action
        self.wind = self.rng.normal()
        self.add_reward(agent, float(action), term="stride")
        if action == 2:
            for other in self.agents:
                self.add_reward(other, 0.25, term="team")
        if agent == "runner_1" and self.turn > 4:
            self.terminate(agent, "tired")
        if self.place >= self.length:
            for other in list(self.agents):
                self.terminate(other, "arrived")

    def observe(self, agent: str) -> Any:
        return np.array([float(self.place), min(max(self.wind, -1.0), 1.0)])

    def info(self, agent: str) -> dict[str, Any]:
        return {"place": self.place, "wall_s": 0.5 + 0.25 * self.turn}

    def mask(self, agent: str) -> Any:
        return np.array([1, 1, self.turn % 2 == 0], np.int8)
