"""Bookkeeping of PettingZoo's two APIs, on numpy alone; the games stand in the files beside."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import deepcopy
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Space
from pettingzoo import AECEnv, ParallelEnv


def vector(*numbers: float) -> Any:
    """An observation of numbers."""
    return np.array(numbers, dtype=np.float32)


def box(size: int, low: float = -100.0, high: float = 100.0) -> Box:
    """A space of `size` numbers."""
    return Box(low, high, (size,), np.float32)


def names(role: str, count: int) -> list[str]:
    """Agents of a role."""
    return [f"{role}_{i}" for i in range(count)]


def role_of(agent: str) -> str:
    """The role in an agent's name."""
    return agent.rsplit("_", 1)[0]


def _by_agent(agents: Iterable[str], spaces: Space[Any] | Mapping[str, Space[Any]]) -> Any:
    """A space of its own for each agent, from one space or from one by role."""
    if isinstance(spaces, Space):
        return {agent: deepcopy(spaces) for agent in agents}
    return {agent: deepcopy(spaces[role_of(agent)]) for agent in agents}


class _Frame:
    """Agents, spaces, generator and the hooks that a game fills in."""

    metadata: ClassVar[dict[str, Any]]
    render_mode = None

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "metadata" not in vars(cls):
            cls.metadata = {"name": f"{cls.__name__.lower()}_v0", "render_modes": []}

    def __init__(self, agents: list[str], observes: Any, acts: Any, horizon: int | None) -> None:
        self.possible_agents = list(agents)
        self.observation_spaces = _by_agent(agents, observes)
        self.action_spaces = _by_agent(agents, acts)
        self.horizon = horizon
        self.rng: np.random.Generator | None = None

    def observation_space(self, agent: str) -> Any:
        """The agent's observation space."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """The agent's action space."""
        return self.action_spaces[agent]

    def _seed(self, seed: int | None) -> Any:
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.t = 0
        return self.rng

    def _first(self) -> list[str]:
        """Agents at the start."""
        return list(self.possible_agents)

    def _start(self, rng: Any) -> None: ...

    def _look(self, agent: str) -> Any:
        raise NotImplementedError

    def _mask(self, agent: str) -> Any:
        return None

    def _info(self, agent: str) -> dict[str, Any]:
        mask = self._mask(agent)
        return {} if mask is None else {"action_mask": np.array(mask, dtype=np.int8)}


class Ticks(_Frame, ParallelEnv):
    """Parallel: `_tick` gets the caller's dictionary and uses `_pay`, `_end`, `_cut`, `_join`."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Starts an episode."""
        rng = self._seed(seed)
        self.agents = self._first()
        self._start(rng)
        looks = {agent: self._look(agent) for agent in self.agents}
        return looks, {agent: self._info(agent) for agent in self.agents}

    def _pay(self, agent: str, reward: float) -> None:
        self._rewards[agent] += float(reward)

    def _end(self, *agents: str) -> None:
        self._ended.update(agents)

    def _cut(self, *agents: str) -> None:
        self._stopped.update(agents)

    def _join(self, agent: str) -> None:
        self._joined.append(agent)

    def _tick(self, actions: Any) -> None:
        raise NotImplementedError

    def step(self, actions: Any) -> Any:
        """Plays one tick."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        self._rewards = dict.fromkeys(self.agents, 0.0)
        self._ended, self._stopped, self._joined = set(), set(), []
        self.t += 1
        self._tick(actions)
        there = self.agents + self._joined
        rewards = {agent: self._rewards.get(agent, 0.0) for agent in there}
        late = self.horizon is not None and self.t >= self.horizon
        ends = {agent: agent in self._ended for agent in there}
        cuts = {a: a in self._stopped or (late and not ends[a]) for a in there}
        self.agents = [agent for agent in there if not (ends[agent] or cuts[agent])]
        looks = {agent: self._look(agent) for agent in there}
        return looks, rewards, ends, cuts, {agent: self._info(agent) for agent in there}


class Turns(_Frame, AECEnv):
    """AEC: `_act` plays one turn, `_close` the end of a round, `_order` gives the next round."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Starts an episode."""
        rng = self._seed(seed)
        self.agents = self._first()
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: {} for agent in self.agents}
        self._skip_agent_selection = None
        self._start(rng)
        self._queue = list(self._order())
        self.agent_selection = self._queue[0]
        self.infos = {agent: self._info(agent) for agent in self.agents}

    def observe(self, agent: str) -> Any:
        """The agent's observation."""
        return self._look(agent)

    def _alive(self, agent: str) -> bool:
        return agent in self.agents and not (self.terminations[agent] or self.truncations[agent])

    def _live(self) -> list[str]:
        return [agent for agent in self.agents if self._alive(agent)]

    def _pay(self, agent: str, reward: float) -> None:
        self.rewards[agent] += float(reward)

    def _end(self, *agents: str) -> None:
        self.terminations.update(dict.fromkeys(agents, True))

    def _cut(self, *agents: str) -> None:
        self.truncations.update(dict.fromkeys(agents, True))

    def _join(self, agent: str) -> None:
        self.agents.append(agent)
        self.rewards[agent] = self._cumulative_rewards[agent] = 0.0
        self.terminations[agent] = self.truncations[agent] = False
        self.infos[agent] = {}

    def _order(self) -> list[str]:
        return self._live()

    def _act(self, agent: str, action: Any) -> None:
        raise NotImplementedError

    def _close(self) -> None: ...

    def _advance(self) -> None:
        self._queue = [agent for agent in self._queue[1:] if self._alive(agent)]
        if not self._queue:
            self.t += 1
            self._close()
            if self.horizon is not None and self.t >= self.horizon:
                self._cut(*self._live())
            self._queue = [agent for agent in self._order() if self._alive(agent)]
        if self._queue:
            self.agent_selection = self._queue[0]

    def step(self, action: Any) -> None:
        """Plays the selected agent's turn."""
        agent = self.agent_selection
        if not self._alive(agent):
            self._was_dead_step(action)
            return
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        self._act(agent, action)
        self._advance()
        self._accumulate_rewards()
        self.infos = {each: self._info(each) for each in self.agents}
        self._deads_step_first()
