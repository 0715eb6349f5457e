"""A sound game of each API, small and with chance, that sound environments of tests bend."""

from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv


class Valley(ParallelEnv):
    """Climbers stand on a line of heights; each is paid for its height, in a unit of choice.

    Args:
        unit: what a height of one pays.
        kind: makes a reward of a number.
        ticks: until all are truncated.
    """

    metadata = {"name": "valley_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(
        self,
        ids: Sequence[Hashable] = ("a", "b", "c"),
        unit: float = 1.0,
        kind: Callable[[float], Any] = float,
        ticks: int = 12,
    ) -> None:
        self.possible_agents = list(ids)
        self.agents: list[Any] = []
        self.unit, self.kind, self.ticks, self.render_mode = unit, kind, ticks, None
        self._seen = {a: self.seen_space() for a in ids}
        self._done = {a: self.done_space() for a in ids}
        self.rng: Any = None

    def seen_space(self) -> spaces.Space[Any]:
        """What an agent observes: its height, and the sum of all."""
        return spaces.Box(-np.inf, np.inf, (2,), np.float64)

    def done_space(self) -> spaces.Space[Any]:
        """Down, stay, up."""
        return spaces.Discrete(3)

    def observation_space(self, agent: Any) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: Any) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Draws the heights."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents, self.tick = self.possible_agents[:], 0
        self.heights = {a: float(self.rng.normal()) for a in self.agents}
        return self.views(), {a: {} for a in self.agents}

    def step(self, actions: dict[Any, Any]) -> Any:
        """All climb at once."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        acting = self.agents[:]
        self.tick += 1
        for agent in acting:
            self.heights[agent] += self.climbed(actions[agent]) + 0.1 * float(self.rng.normal())
        rewards = {a: self.reward(a) for a in acting}
        late = self.tick >= self.ticks
        self.agents = [] if late else acting
        ended = dict.fromkeys(acting, False)
        return self.views(), rewards, ended, dict.fromkeys(acting, late), {a: {} for a in acting}

    def climbed(self, action: Any) -> float:
        """How far an action leads up."""
        return float(int(action) - 1)

    def reward(self, agent: Any) -> Any:
        """Its height, in the unit."""
        return self.kind(self.unit * self.heights[agent])

    def views(self) -> dict[Any, Any]:
        """What everybody observes; arrays of their own."""
        return {a: self.view(a) for a in self.heights}

    def view(self, agent: Any) -> Any:
        """Own height and the sum."""
        return np.array([self.heights[agent], sum(self.heights.values())])


class Table(AECEnv):
    """Players in turn stake on a coin; whoever acts wins or loses, in a unit of choice."""

    metadata = {"name": "table_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(
        self,
        ids: Sequence[Hashable] = ("a", "b", "c"),
        unit: float = 1.0,
        kind: Callable[[float], Any] = float,
        turns: int = 24,
    ) -> None:
        super().__init__()
        self.possible_agents = list(ids)
        self.agents: list[Any] = []
        self.unit, self.kind, self.turns, self.render_mode = unit, kind, turns, None
        self._seen = {a: self.seen_space() for a in ids}
        self._done = {a: self.done_space() for a in ids}
        self.rng: Any = None

    def seen_space(self) -> spaces.Space[Any]:
        """What a player observes: own purse and the coin."""
        return spaces.Box(-np.inf, np.inf, (2,), np.float64)

    def done_space(self) -> spaces.Space[Any]:
        """How much is staked."""
        return spaces.Discrete(3)

    def observation_space(self, agent: Any) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._seen[agent]

    def action_space(self, agent: Any) -> spaces.Space[Any]:
        """The same object at every call."""
        return self._done[agent]

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Empty purses and a coin."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.agents, self.turn = self.possible_agents[:], 0
        self.rewards = dict.fromkeys(self.agents, self.kind(0.0))
        self._cumulative_rewards = dict.fromkeys(self.agents, self.kind(0.0))
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: dict[Any, Any] = {a: {} for a in self.agents}
        self._skip_agent_selection = None
        self.purses = dict.fromkeys(self.agents, 0.0)
        self.coin = float(self.rng.normal())
        self.agent_selection = self.agents[0]

    def observe(self, agent: Any) -> Any:
        """Own purse and the coin."""
        return np.array([self.purses[agent], self.coin])

    def step(self, action: Any) -> None:
        """One stake."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = self.kind(0.0)
        before = dict(self.rewards)
        self._clear_rewards()
        won = (1.0 + self.staked(action)) * self.coin
        self.purses[agent] += won
        self.pay(agent, won, before)
        self.coin = float(self.rng.normal())
        self.turn += 1
        if self.turn >= self.turns:
            self.truncations = dict.fromkeys(self.agents, True)
        self.agent_selection = self.following(agent)
        self._accumulate_rewards()
        self._deads_step_first()

    def staked(self, action: Any) -> float:
        """What an action stakes."""
        return float(action)

    def pay(self, agent: Any, won: float, before: dict[Any, Any]) -> None:
        """The player wins it, the next one loses it."""
        self.rewards[agent] = self.kind(self.unit * won)
        self.rewards[self.following(agent)] = self.kind(-self.unit * won)

    def following(self, agent: Any) -> Any:
        """The next in the ring."""
        return self.agents[(self.agents.index(agent) + 1) % len(self.agents)]
