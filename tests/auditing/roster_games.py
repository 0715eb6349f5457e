"""A counting game of both APIs whose rosters, dictionaries and flags tests bend."""

from collections.abc import Callable, Hashable
from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import AECEnv, ParallelEnv

SEEN = spaces.Discrete(100)
DONE = spaces.Discrete(2)

Bend = Callable[[Any, tuple[dict[Any, Any], ...]], Any]


class Counting(ParallelEnv):
    """Agents count ticks; agent number k ends after `ends[k]`; `bend` changes what step returns."""

    metadata = {"name": "counting_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(
        self,
        ids: tuple[Hashable, ...] = ("a", "b", "c"),
        ends: tuple[int, ...] = (3, 5, 7),
        limit: int = 50,
        bend: Bend | None = None,
    ) -> None:
        self.possible_agents = list(ids)
        self.agents: list[Any] = []
        self.ends = dict(zip(ids, ends, strict=True))
        self.ticks_to_go, self.bend, self.render_mode = limit, bend, None

    def observation_space(self, agent: Any) -> Any:
        """A number for all."""
        return SEEN

    def action_space(self, agent: Any) -> Any:
        """Two actions for all."""
        return DONE

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Starts to count."""
        self.agents, self.tick = self.possible_agents[:], 0
        return dict.fromkeys(self.agents, 0), {a: {} for a in self.agents}

    def step(self, actions: dict[Any, Any]) -> Any:
        """Counts; who ends leaves."""
        acting = self.agents[:]
        if not acting:
            return {}, {}, {}, {}, {}
        self.tick += 1
        ended = {a: self.tick >= self.ends.get(a, 99) for a in acting}
        late = {a: not ended[a] and self.tick >= self.ticks_to_go for a in acting}
        self.agents = [a for a in acting if not ended[a] and not late[a]]
        seen, infos = dict.fromkeys(acting, self.tick), {a: {} for a in acting}
        out = seen, dict.fromkeys(acting, 1.0), ended, late, infos
        return out if self.bend is None else self.bend(self, out)


class Turning(AECEnv):
    """The same in turns: everybody counts once a tick; `bend` changes books after a step."""

    metadata = {"name": "turning_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def __init__(
        self,
        ids: tuple[Hashable, ...] = ("a", "b", "c"),
        ends: tuple[int, ...] = (3, 5, 7),
        bend: Callable[[Any], None] | None = None,
    ) -> None:
        super().__init__()
        self.possible_agents = list(ids)
        self.agents: list[Any] = []
        self.ends = dict(zip(ids, ends, strict=True))
        self.bend, self.render_mode = bend, None

    def observation_space(self, agent: Any) -> Any:
        """A number for all."""
        return SEEN

    def action_space(self, agent: Any) -> Any:
        """Two actions for all."""
        return DONE

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Starts to count."""
        self.agents = self.possible_agents[:]
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: dict[Any, Any] = {a: {} for a in self.agents}
        self.counts = dict.fromkeys(self.agents, 0)
        self._skip_agent_selection = None
        self.agent_selection = self.agents[0]

    def observe(self, agent: Any) -> Any:
        """How often it has counted."""
        return np.int64(self.counts[agent])

    def step(self, action: Any) -> None:
        """Counts; who ends has one more turn."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
        else:
            self._cumulative_rewards[agent] = 0.0
            self._clear_rewards()
            self.counts[agent] += 1
            self.rewards[agent] = 1.0
            self.terminations[agent] = self.counts[agent] >= self.ends[agent]
            place = self.agents.index(agent) + 1
            self.agent_selection = self.agents[place % len(self.agents)]
            self._accumulate_rewards()
            self._deads_step_first()
        if self.bend is not None and self.agents:
            self.bend(self)


class Stops(Turning):
    """Over for all as one has counted enough; a step after that changes nothing."""

    def step(self, action: Any) -> None:
        """Counts, and pays all at the end."""
        if any(self.terminations.values()):
            return
        super().step(action)
        if any(self.terminations.values()):
            self.terminations = dict.fromkeys(self.agents, True)
            self.rewards = dict.fromkeys(self.agents, 1.0)


class OneMask(Turning):
    """Shows each agent the mask in its info, one array for all."""

    def observation_space(self, agent: Any) -> Any:
        """The mask."""
        return spaces.MultiBinary(2)

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Makes the mask."""
        super().reset()
        mask = np.ones(2, np.int8)
        self.infos = {agent: {"action_mask": mask} for agent in self.agents}

    def observe(self, agent: Any) -> Any:
        """The mask, as it lies there."""
        return self.infos[agent]["action_mask"]


class OneBuffer(Turning):
    """Writes the mask of each agent into one array, so that all are told the last one's."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Makes the masks."""
        self.mask = np.ones(2, np.int8)
        super().reset()
        self.tell()

    def may(self, agent: Any) -> bool:
        """The second action is of every other agent and turn."""
        return bool((self.counts[agent] + self.possible_agents.index(agent)) % 2)

    def tell(self) -> None:
        """Each is told its mask."""
        for agent in self.agents:
            self.mask[1] = self.may(agent)
            self.infos[agent] = {"action_mask": self.mask}

    def step(self, action: Any) -> None:
        """Refuses what isn't allowed."""
        if action == 1 and not self.may(self.agent_selection):
            raise ValueError("not now")
        super().step(action)
        self.tell()


class Made:
    """An agent that equals itself alone."""


class MadeAnew(ParallelEnv):
    """Each reset makes its agents, and a step returns too little."""

    metadata = {"name": "made_anew_v0", "render_modes": []}  # noqa: RUF012  # as PettingZoo has it

    def observation_space(self, agent: Any) -> Any:
        """One for all."""
        return DONE

    action_space = observation_space

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Two agents that nobody has met."""
        self.agents = [Made(), Made()]
        return dict.fromkeys(self.agents, 0), {a: {} for a in self.agents}

    def step(self, actions: Any) -> Any:
        """Two dictionaries of five."""
        return {a: actions[a] for a in self.agents}, dict.fromkeys(self.agents, 0.0)
