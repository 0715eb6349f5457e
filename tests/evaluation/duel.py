"""A game of one step whose truth is known: strength, luck, and what may go wrong."""

from typing import Any

import numpy as np
from gymnasium.spaces import Discrete
from pettingzoo import ParallelEnv


class Duel(ParallelEnv):
    """Two agents act once: the stronger wins 1, or each is paid its own strength.

    `crash`: chance of an exception; `bad`: of a reward that isn't finite, of p1 alone;
    `is_seeded`: resets follow their seed; `is_team`: both are paid for what they do.
    """

    metadata: dict[str, Any] = {"name": "duel_v0"}  # noqa: RUF012  # PettingZoo's own form

    def __init__(self, **told: Any) -> None:
        self.possible_agents = ["p0", "p1"][: told.get("agents", 2)]
        self.told = {"crash": 0.0, "bad": 0.0, "is_seeded": True, "is_team": False, **told}
        self.rng = np.random.default_rng()

    def observation_space(self, agent: str) -> Any:
        """The deal."""
        return Discrete(1000)

    def action_space(self, agent: str) -> Any:
        """Strength."""
        return Discrete(101)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Deals."""
        self.rng = np.random.default_rng(seed if self.told["is_seeded"] else None)
        self.agents = list(self.possible_agents)
        deal = int(self.rng.integers(1000))
        return dict.fromkeys(self.agents, deal), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, int]) -> Any:
        """Pays."""
        luck, fate = self.rng.normal(size=2), self.rng.random(2)
        if fate[0] < self.told["crash"]:
            raise RuntimeError("the engine died")
        agents, self.agents = self.agents, []
        rewards = {a: actions[a] + float(x) for a, x in zip(agents, luck, strict=False)}
        if not self.told["is_team"]:
            first = float((actions["p0"] - actions["p1"]) / 20 + luck[0] > 0)
            rewards = {"p0": first, "p1": 1.0 - first}
        if fate[1] < self.told["bad"]:
            rewards[agents[-1]] = float("nan")
        ended = dict.fromkeys(agents, True)
        kept = dict.fromkeys(agents, False)
        return dict.fromkeys(agents, 0), rewards, ended, kept, {agent: {} for agent in agents}


class Rock(Duel):
    """Rock, script, scissors; now and then the wrong one wins."""

    def step(self, actions: dict[str, int]) -> Any:
        """Pays."""
        agents, self.agents = self.agents, []
        won = (actions["p0"] - actions["p1"]) % 3
        sign = {0: float(self.rng.choice([-1, 1])), 1: 1.0, 2: -1.0}[won]
        sign = sign if self.rng.random() < 0.8 else -sign
        ended, kept = dict.fromkeys(agents, True), dict.fromkeys(agents, False)
        rewards = {"p0": sign, "p1": -sign}
        return dict.fromkeys(agents, 0), rewards, ended, kept, {agent: {} for agent in agents}


class Strength:
    """Always does the same."""

    def __init__(self, number: int) -> None:
        self.number, self.version = number, f"strength {number}"

    def __call__(self, observation: Any, agent: Any, info: Any, rng: Any) -> Any:
        """Its strength."""
        return self.number
