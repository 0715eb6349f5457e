"""Small games whose attribution is known by their rules."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from pettingzoo import ParallelEnv

import gamekeeper as gk

HERE = f"{Path(__file__)}"
STILL, STEP, SHOVE = range(3)
TICKS = 12

SHOVING = gk.Contract.parse("""
name = "shoving_v0"
api = "parallel"
[roles.robot]
agents = "robot_*"
noop = 0
messages = []
[rewards.progress]
kind = "shared"
earner = "robot"
payee = "all"
[rewards.bump]
kind = "individual"
earner = "robot"
payee = "earner"
""")


class Shoving(gk.TickEnv):
    """Who steps earns all robots 1; who shoves makes the next one pay, or pays itself.

    With `fair` the shoving one pays for its shove, else the one that is shoved.
    """

    metadata = {"name": "shoving_v0", "is_parallelizable": True}  # noqa: RUF012

    def __init__(self, fair: bool = True, robots: int = 3) -> None:
        super().__init__()
        self.fair = fair
        self.possible_agents = [f"robot_{k}" for k in range(robots)]
        self.observation_spaces = {a: Box(0, 99, (2,), np.int64) for a in self.possible_agents}
        self.action_spaces = {a: Discrete(3) for a in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """Nobody has been shoved."""
        self.shoved = dict.fromkeys(self.possible_agents, 0)
        self.clock = 0

    def tick(self, actions: Any) -> None:
        """Steps and shoves."""
        names = self.possible_agents
        for place, (agent, action) in enumerate(actions.items()):
            after = names[(place + 1) % len(names)]
            if action == STEP:
                for each in names:
                    self.add_reward(each, 1.0, term="progress")
            elif action == SHOVE:
                self.shoved[after] += 1
                self.add_reward(agent if self.fair else after, -0.5, term="bump")
        self.clock += 1
        if self.clock == TICKS:
            for agent in list(self.agents):
                self.truncate(agent, "horizon")

    def observe(self, agent: str) -> Any:
        """The time, and how often it was shoved."""
        return np.array([self.clock, self.shoved[agent]])


class PlainShoving(ParallelEnv):  # type: ignore[type-arg]  # as its users write it
    """The same as an ordinary environment, with the terms in infos, somewhere or nowhere.

    `told`: `plain` (fields of the info), `nested` (one level deeper), `total` (running totals, so
    that they aren't what was paid) or `never`.
    """

    metadata = {"name": "shoving_v0"}  # noqa: RUF012  # as PettingZoo has it

    def __init__(self, told: str = "plain", fair: bool = False) -> None:
        self.told, self.inner = told, Shoving(fair)
        self.possible_agents = self.inner.possible_agents
        self.observation_space = self.inner.observation_space
        self.action_space = self.inner.action_space

    @property
    def agents(self) -> Any:
        """The live ones."""
        return self.inner.agents

    @agents.setter
    def agents(self, value: Any) -> None:
        self.inner.agents = value

    def reset(self, seed: Any = None, options: Any = None) -> Any:
        """Resets."""
        self.sums: Any = {agent: Counter() for agent in self.possible_agents}
        return self.inner.reset(seed, options)

    def step(self, actions: Any) -> Any:
        """A tick."""
        observations, rewards, over, cut, _ = self.inner.step(actions)
        return observations, rewards, over, cut, {a: self._told(a) for a in rewards}

    def _told(self, agent: str) -> Any:
        paid = dict(self.inner.terms.get(agent, {}))
        self.sums[agent].update(paid)
        infos = {"plain": paid, "nested": {"paid": paid}, "total": dict(self.sums[agent])}
        return infos.get(self.told, {})


class ShovingInTurns(gk.TurnEnv):
    """The same, one robot after the other."""

    metadata = {"name": "shoving_turns_v0", "is_parallelizable": True}  # noqa: RUF012

    def __init__(self, fair: bool = True) -> None:
        super().__init__()
        self.fair = fair
        self.possible_agents = ["robot_0", "robot_1", "robot_2"]
        self.observation_spaces = {a: Box(0, 99, (1,), np.int64) for a in self.possible_agents}
        self.action_spaces = {a: Discrete(3) for a in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """The first turn."""
        self.clock = 0

    def act(self, agent: str, action: Any) -> None:
        """A step or a shove."""
        names = self.possible_agents
        after = names[(names.index(agent) + 1) % 3]
        if action == STEP:
            for each in names:
                self.add_reward(each, 1.0, term="progress")
        elif action == SHOVE:
            self.add_reward(agent if self.fair else after, -0.5, term="bump")
        self.clock += 1
        if self.clock == 3 * TICKS:
            for each in list(self.agents):
                self.truncate(each, "horizon")

    def observe(self, agent: str) -> Any:
        """Rounds so far."""
        return np.array([self.clock // 3])


def make(**kwargs: Any) -> Shoving:
    """For `file.py:make`."""
    return Shoving(**kwargs)


def step(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Always steps."""
    return STEP


def shove_at_times(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Steps, and shoves every third tick."""
    return SHOVE if int(observation[0]) % 3 == 0 else STEP


def still(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Does nothing."""
    return STILL


TALKING = gk.Contract.parse("""
name = "talking_v0"
api = "parallel"
[roles.speaker]
noop = "none"
messages = ["action"]
[roles.hearer]
noop = 0
messages = ["observation[1:2]"]
[rewards.guess]
kind = "shared"
earner = "all"
payee = "all"
""")


class Talking(gk.TickEnv):
    """The speaker sees one of four goals and says a word; the hearer hears it and guesses."""

    metadata = {"name": "talking_v0", "is_parallelizable": True}  # noqa: RUF012

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["speaker_0", "hearer_0"]
        self.observation_spaces = {a: Box(0, 9, (2,), np.int64) for a in self.possible_agents}
        self.action_spaces = {a: Discrete(5) for a in self.possible_agents}

    def start(self, rng: Any, options: Any) -> None:
        """A goal is drawn, nothing is said."""
        self.goal, self.word, self.clock = int(rng.integers(4)), 4, 0

    def tick(self, actions: Any) -> None:
        """The word is heard after the tick."""
        if actions.get("hearer_0") == self.goal:
            for agent in self.possible_agents:
                self.add_reward(agent, 1.0, term="guess")
        self.word = int(actions.get("speaker_0", 4))
        self.clock += 1
        if self.clock == 5:
            for agent in list(self.agents):
                self.truncate(agent, "horizon")

    def observe(self, agent: str) -> Any:
        """The speaker: the goal. The hearer: the time and the word."""
        if agent == "speaker_0":
            return np.array([self.goal, 0])
        return np.array([self.clock, self.word])


class Thrust(gk.TickEnv):
    """Two drones, each paid for its own thrust, a number in a dictionary of arrays."""

    metadata = {"name": "thrust_v0", "is_parallelizable": True}  # noqa: RUF012  # PettingZoo's form

    def __init__(self) -> None:
        super().__init__()
        self.possible_agents = ["drone_0", "drone_1"]
        thrust = Box(-1, 1, (2,), np.float64)
        self.observation_spaces = {a: Box(-99, 99, (2,), np.float64) for a in self.possible_agents}
        self.action_spaces = {"drone_0": thrust, "drone_1": Dict({"thrust": thrust})}

    def start(self, rng: Any, options: Any) -> None:
        """Nothing was done."""
        self.places = {agent: np.zeros(2) for agent in self.possible_agents}
        self.clock = 0

    def tick(self, actions: Any) -> None:
        """Each moves by itself."""
        for agent, action in actions.items():
            thrust = action if agent == "drone_0" else action["thrust"]
            self.places[agent] = self.places[agent] + thrust
            self.add_reward(agent, float(thrust[0]))
        self.clock += 1
        if self.clock == 6:
            for agent in list(self.agents):
                self.truncate(agent, "horizon")

    def observe(self, agent: str) -> Any:
        """Where it is."""
        return self.places[agent].copy()


def says_goal(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Says the goal."""
    return int(observation[0])


def babbles(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Says anything."""
    return int(rng.integers(4))


def obeys(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Does what it hears."""
    return int(observation[1])


def is_deaf(observation: Any, agent: Any, info: Any, rng: Any) -> int:
    """Guesses by itself."""
    return int(rng.integers(4))
