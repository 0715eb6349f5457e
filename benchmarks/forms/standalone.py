"""Environments with their own bookkeeping, as PettingZoo's documentation shows it."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import AgentSelector

from benchmarks.forms.form import TIME, Ending, Form, Part, links


class Relay(AECEnv):
    """A runner, then a jumper, then a thrower score for their team, each from the mark before it.

    Each takes 0, 1 or 2 of risk; the mark of the one before is seen and is the base of the next.
    A mark is base + risk, or 0 where a drawn number is below risk / 4. The thrower's mark is paid
    to all at the end of the round; ten rounds are a match.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "relay_v0", "render_modes": []}

    def __init__(self) -> None:
        self.possible_agents = ["runner", "jumper", "thrower"]
        self.spaces = {agent: Box(0, 20, (1,), np.float32) for agent in self.possible_agents}
        self.acts = {agent: Discrete(3) for agent in self.possible_agents}
        self.render_mode = None
        self.rng = np.random.default_rng()

    def observation_space(self, agent: str) -> Any:
        """The mark of the one before."""
        return self.spaces[agent]

    def action_space(self, agent: str) -> Any:
        """The risk."""
        return self.acts[agent]

    def observe(self, agent: str) -> Any:
        """The mark of the one before, where it is the agent's turn."""
        mine = agent == self.agent_selection
        return np.array([self.mark if mine else 0], dtype=np.float32)

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Starts a match."""
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        self.agents = self.possible_agents[:]
        self.t, self.mark = 0, int(self.rng.integers(1, 4))
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: {} for agent in self.agents}
        self.selector = AgentSelector(self.agents)
        self.agent_selection = self.selector.next()

    def step(self, action: Any) -> None:
        """Plays one turn."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        risk = int(action)
        self.mark = 0 if self.rng.random() < risk / 4 else self.mark + risk
        self.rewards = dict.fromkeys(self.agents, 0.0)
        if self.selector.is_last():
            self.rewards = dict.fromkeys(self.agents, float(self.mark))
            self.t, self.mark = self.t + 1, int(self.rng.integers(1, 4))
            self.truncations = dict.fromkeys(self.agents, self.t >= 10)
        self.agent_selection = self.selector.next()
        self._accumulate_rewards()


RELAY = Form(
    name="relay",
    api="aec",
    stages=(("runner",), ("jumper",), ("thrower",)),
    order="fixed",
    observe="after turn",
    conflicts="ordered",
    rewards={"mark": Part("all", "all", "shared")},
    endings={"time": TIME},
    symmetric={"runner": None, "jumper": None, "thrower": None},
    horizon=10,
    influence=links(
        "runner jumper observation 0",
        "runner thrower observation 0",
        "jumper thrower observation 0",
        *[
            f"{a} {b} reward 0"
            for a in ("runner", "jumper", "thrower")
            for b in ("runner", "jumper", "thrower")
            if a != b
        ],
    ),
    order_sensitive=None,
    advice="aec",
    because=("state",),
)


class Turnip(ParallelEnv):
    """Six hands pull a turnip by 0 to 1; it comes out, for all, when their sum reaches its weight.

    The weight is drawn; each tick costs a hand its own pull, and the turnip pays each 4.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "turnip_v0", "render_modes": []}
    render_mode = None

    def __init__(self) -> None:
        self.possible_agents = [f"hand_{i}" for i in range(6)]
        self.spaces = {agent: Box(0, 6, (2,), np.float32) for agent in self.possible_agents}
        self.acts = {agent: Box(0, 1, (1,), np.float32) for agent in self.possible_agents}
        self.rng = np.random.default_rng()

    def observation_space(self, agent: str) -> Any:
        """The weight and the last sum of pulls."""
        return self.spaces[agent]

    def action_space(self, agent: str) -> Any:
        """The pull."""
        return self.acts[agent]

    def _see(self) -> dict[str, Any]:
        return {a: np.array([self.weight, self.sum], np.float32) for a in self.agents}

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Starts an episode."""
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        self.agents, self.t = self.possible_agents[:], 0
        self.weight, self.sum = float(self.rng.uniform(3.5, 5)), 0.0
        return self._see(), {agent: {} for agent in self.agents}

    def step(self, actions: Any) -> Any:
        """Plays one tick."""
        pulls = {a: min(1.0, max(0.0, float(actions[a][0]))) for a in self.agents}
        self.sum, self.t = sum(pulls[a] for a in self.agents), self.t + 1
        out, late = self.sum >= self.weight, self.t >= 23
        seen, infos = self._see(), {agent: {} for agent in self.agents}
        rewards = {agent: 4.0 * out - pulls[agent] for agent in self.agents}
        ends = dict.fromkeys(self.agents, out)
        cuts = dict.fromkeys(self.agents, late and not out)
        self.agents = [] if out or late else self.agents
        return seen, rewards, ends, cuts, infos


TURNIP = Form(
    name="turnip",
    api="parallel",
    stages=(("hand",),),
    order="none",
    observe="after tick",
    conflicts="joint rule",
    rewards={"turnip": Part("hand", "all", "shared"), "pull": Part("hand", "earner", "individual")},
    endings={"out": Ending("termination", "all"), "time": TIME},
    symmetric={"hand": True},
    horizon=23,
    influence=links("hand hand reward 0", "hand hand observation 1", "hand hand ending 0"),
    order_sensitive="none",
    advice="parallel",
)

FORMS = ((Relay, RELAY), (Turnip, TURNIP))
