"""A game played from a script: by PettingZoo's documented pattern, and on the base class."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Discrete
from hypothesis import strategies as st
from pettingzoo import AECEnv

from gamekeeper.interface.turn_env import TurnEnv

NAMES = [f"agent_{i}" for i in range(12)]
SPACE = Discrete(2)


@dataclass(frozen=True)
class Play:
    """What one turn does. Numbers of agents are taken modulo the length of the roster."""

    pays: tuple[tuple[int, float], ...]
    ends: tuple[tuple[int, bool], ...]
    joins: int
    then: int | None  # None: whoever comes next in the roster


AMOUNTS = st.floats(-1e6, 1e6) | st.integers(-3, 3)
PLAYS = st.builds(
    Play,
    st.lists(st.tuples(st.integers(0, 11), AMOUNTS), max_size=4).map(tuple),
    st.just(()) | st.lists(st.tuples(st.integers(0, 11), st.booleans()), max_size=3).map(tuple),
    st.sampled_from([0, 0, 0, 1, 2]),
    st.none() | st.integers(0, 11),
)
SCRIPTS = st.lists(PLAYS, min_size=1, max_size=25)


class Documented(AECEnv):  # type: ignore[type-arg, misc]  # no type parameters at run time
    """The pattern of PettingZoo's documentation, with its own helpers, written out."""

    def __init__(self, n: int, script: list[Play]) -> None:
        super().__init__()
        self.possible_agents = NAMES
        self.n, self.script = n, script

    def observe(self, agent: str) -> int:
        return self.turn

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        self.agents = self.possible_agents[: self.n]
        self.rewards = dict.fromkeys(self.agents, 0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos = {agent: {} for agent in self.agents}
        self.agent_selection = self.agents[0]
        self.turn, self.born = 0, self.n

    def step(self, action: Any) -> None:
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        self._clear_rewards()
        self._cumulative_rewards[agent] = 0
        play = self.script[self.turn]
        self.turn += 1
        everybody = self.agents[:]
        for index, amount in play.pays:
            self.rewards[everybody[index % len(everybody)]] += amount
        for index, terminated in play.ends:
            flags = self.terminations if terminated else self.truncations
            flags[everybody[index % len(everybody)]] = True
        for newcomer in NAMES[self.born : self.born + play.joins]:
            self.born += 1
            self.agents.append(newcomer)
            self.rewards[newcomer] = self._cumulative_rewards[newcomer] = 0
            self.terminations[newcomer] = self.truncations[newcomer] = False
            self.infos[newcomer] = {}
        self.agent_selection = self._next_living(agent, play)
        self._accumulate_rewards()
        self._deads_step_first()

    def _next_living(self, agent: str, play: Play) -> str:
        """The scripted agent, or the one after the actor; or the first one after it who lives."""
        first = self.agents.index(agent) + 1 if play.then is None else play.then
        for ahead in range(len(self.agents)):
            other = self.agents[(first + ahead) % len(self.agents)]
            if not (self.terminations[other] or self.truncations[other]):
                return other
        return agent


class OnBase(TurnEnv):
    """The same game as its author would write it on the base class."""

    def __init__(self, n: int, script: list[Play]) -> None:
        super().__init__()
        self.possible_agents = NAMES
        self.action_spaces = dict.fromkeys(NAMES, SPACE)
        self.observation_spaces = dict.fromkeys(NAMES, SPACE)
        self.n, self.script = n, script

    def starting_agents(self) -> list[str]:
        return self.possible_agents[: self.n]

    def start(self, rng: Any, options: Any) -> None:
        self.born = self.n

    def observe(self, agent: str) -> int:
        return self.turns

    def act(self, agent: str, action: int) -> None:
        play = self.script[self.turns - 1]
        everybody = self.agents[:]
        for index, amount in play.pays:
            self.add_reward(everybody[index % len(everybody)], amount)
        for index, terminated in play.ends:
            end = self.terminate if terminated else self.truncate
            end(everybody[index % len(everybody)], f"turn {self.turns}")
        for newcomer in NAMES[self.born : self.born + play.joins]:
            self.born += 1
            self.join(newcomer)


class OnBaseChoosing(OnBase):
    """The same, with an order of its own."""

    def next_agent(self, agent: str) -> str:
        then = self.script[self.turns - 1].then
        if then is None:
            return super().next_agent(agent)  # type: ignore[no-any-return]
        return self.agents[then % len(self.agents)]  # type: ignore[no-any-return]


def same_number(left: object, right: object) -> bool:
    """Equal to the last bit, whatever number type holds it."""
    return np.float64(left).tobytes() == np.float64(right).tobytes()  # type: ignore[arg-type]
