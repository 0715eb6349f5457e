"""Three environments without knobs in which agents depend on messages, for benchmarks/messages.py.

`Quarry` (Parallel): a lookout says a word (Discrete) that two diggers hear as four fields. `Chain`
(AEC, MultiDiscrete): a number is said from one to the next. `Boats` (Parallel, Box): each of two
says where the other has to go. Messages take the air between them, which may lose, delay, garble or
exchange them. Nothing is declared, and nothing here uses the diagnosis' own code.
"""

from collections import deque
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from pettingzoo import ParallelEnv

import gamekeeper as gk

SEAMS = 4
NUMBERS = 6
REACH = 0.15


class Air:
    """The way of one message: as it is, or with a fault of its own.

    Attributes:
        fault: "" or "lost", "late", "garbled", "exchanged".
    """

    def __init__(self, fault: str, blank: Any, *, most: int = 0, turns: int = 13) -> None:
        """Nothing was said yet.

        Args:
            blank: what is heard then.
            most: the sum of a word and the one in whose place it is exchanged.
            turns: by which a late word is late.
        """
        self.fault, self.blank, self.most, self.turns = fault, blank, most, turns
        self.queue: deque[Any] = deque()

    def carried(self, word: Any, others: Any, rng: Any) -> Any:
        """What arrives of a word.

        Args:
            others: draws another word from the stream that it is given.
            rng: the environment's stream.
        """
        self.queue.append(word)
        if self.fault == "lost" and float(rng.uniform(0.0, 1.0)) < 0.85:
            return self.blank
        if self.fault == "garbled" and float(rng.uniform(0.0, 1.0)) < 0.8:
            return others(rng)
        if self.fault == "late":
            return self.queue.popleft() if len(self.queue) > self.turns else self.blank
        if self.fault == "exchanged":
            return self.most - word if isinstance(word, int) else np.asarray(word)[::-1]
        return word


class Quarry(gk.TickEnv):
    """A lookout sees the rich seam and says it; two diggers have to stand there at once."""

    metadata: ClassVar[dict[str, Any]] = {"name": "quarry_v0"}
    air: ClassVar[str] = ""

    def __init__(self, shifts: int = 16, render_mode: str | None = None) -> None:
        """Opens it."""
        super().__init__(render_mode=render_mode)
        self.shifts = shifts
        self.possible_agents = ["lookout_0", "digger_0", "digger_1"]
        seen = Box(0, SEAMS, (SEAMS + 1,), np.float32)
        self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
        self.action_spaces = {a: Discrete(3) for a in self.possible_agents}
        self.action_spaces["lookout_0"] = Discrete(SEAMS)

    def start(self, rng: Any, options: Any) -> None:
        """Draws the seam, which no digger stands at."""
        self.rng, self.ticks = rng, 0
        self.seam = int(rng.integers(SEAMS))
        self.places = {a: int(rng.integers(SEAMS)) for a in ("digger_0", "digger_1")}
        for agent, place in self.places.items():
            if place == self.seam:
                self.places[agent] = (place + 2) % SEAMS
        self.word, self.way = -1, Air(self.air, -1, most=SEAMS - 1)
        self.other_seam = (self.seam + 1 + int(rng.integers(SEAMS - 1))) % SEAMS

    def tick(self, actions: Any) -> None:
        """Diggers walk a line; what is said is heard at the next tick."""
        self.ticks += 1
        for agent in self.places:
            step = int(actions[agent]) - 1
            self.places[agent] = min(max(self.places[agent] + step, 0), SEAMS - 1)
        said = int(actions["lookout_0"])
        self.word = self.way.carried(said, lambda rng: int(rng.integers(SEAMS)), self.rng)
        if all(place == self.seam for place in self.places.values()):
            for agent in self.possible_agents:
                self.add_reward(agent, 1.0)
                self.terminate(agent, "struck")
        elif self.ticks >= self.shifts:
            for agent in self.possible_agents:
                self.truncate(agent, "night")

    def observe(self, agent: str) -> Any:
        """The seam for the lookout, the word for diggers, one field for each; then the place."""
        shown = self.seam if agent == "lookout_0" else self.word
        row = [float(k == shown) for k in range(SEAMS)]
        return np.array([*row, self.places.get(agent, 0)], np.float32)


def quarry(observation: Any, agent: str) -> int:
    """Says the seam; walks to it, and stays where nothing is heard."""
    row = np.asarray(observation[:SEAMS])
    if agent == "lookout_0":
        return int(np.argmax(row))
    if row.max() <= 0:
        return 1
    return 1 + int(np.sign(int(np.argmax(row)) - round(float(observation[SEAMS]))))


class Chain(gk.TurnEnv):
    """A clerk reads a number, a runner passes it on, and a valve is turned to it and pulled."""

    metadata: ClassVar[dict[str, Any]] = {"name": "chain_v0"}
    air: ClassVar[str] = ""

    def __init__(self, patience: int = 14, render_mode: str | None = None) -> None:
        """Opens it."""
        super().__init__(render_mode=render_mode)
        self.patience = patience
        self.possible_agents = ["clerk", "runner", "valve"]
        seen = MultiDiscrete([NUMBERS + 1, NUMBERS + 1])
        self.observation_spaces = dict.fromkeys(self.possible_agents, seen)
        self.action_spaces = {a: MultiDiscrete([NUMBERS + 1]) for a in ("clerk", "runner")}
        self.action_spaces["valve"] = MultiDiscrete([3, 2])

    def start(self, rng: Any, options: Any) -> None:
        """Draws the number, from 1; 0 is silence."""
        self.rng, self.rounds = rng, 0
        self.number, self.at = 1 + int(rng.integers(NUMBERS)), int(rng.integers(NUMBERS + 1))
        if abs(self.at - self.number) < 2:
            self.at = (self.number + 3) % (NUMBERS + 1)
        self.heard = {"runner": 0, "valve": 0}
        self.ways = {a: Air(self.air, 0, most=NUMBERS + 1) for a in self.heard}
        self.ways["valve"].fault = ""

    def act(self, agent: str, action: Any) -> None:
        """A word, or a turn of the valve and a pull, which has to be right."""
        if agent != "valve":
            other = "runner" if agent == "clerk" else "valve"
            said = int(action[0])
            self.heard[other] = self.ways[other].carried(
                said, lambda rng: 1 + int(rng.integers(NUMBERS)), self.rng
            )
            return
        self.rounds += 1
        self.at = min(max(self.at + int(action[0]) - 1, 0), NUMBERS)
        is_pulled = bool(action[1])
        for each in self.possible_agents:
            if is_pulled:
                self.add_reward(each, float(self.at == self.number))
                self.terminate(each, "pulled")
            elif self.rounds >= self.patience:
                self.truncate(each, "late")

    def observe(self, agent: str) -> Any:
        """The number, or what was heard; and where the valve stands."""
        first = self.number if agent == "clerk" else self.heard[agent]
        return np.array([first, self.at if agent == "valve" else 0], np.int64)


class Patient:
    """The valve's way: it pulls once it heard the same for two turns, and stands there."""

    def __call__(self, observation: Any, agent: str) -> Any:
        """The action."""
        first, at = int(observation[0]), int(observation[1])
        if agent != "valve":
            return np.array([min(max(first, 0), NUMBERS)], np.int64)
        if not first:
            return np.array([1, 0], np.int64)
        return np.array([1 + int(np.sign(first - at)), int(first == at)], np.int64)


chain = Patient()


class Boats(ParallelEnv):  # type: ignore[type-arg]  # as users write it
    """Each boat sees the other's goal and says it; each sails to what it hears."""

    metadata: ClassVar[dict[str, Any]] = {"name": "boats_v0"}
    air: ClassVar[str] = ""

    def __init__(self, max_cycles: int = 36, render_mode: str | None = None) -> None:
        """Opens it."""
        self.max_cycles, self.render_mode = max_cycles, render_mode
        self.possible_agents = ["boat_0", "boat_1"]
        self.agents: list[str] = []
        self.seen, self.acts = Box(-2, 2, (6,), np.float32), Box(-1, 1, (4,), np.float32)

    def observation_space(self, agent: str) -> Any:
        """Its space."""
        return self.seen

    def action_space(self, agent: str) -> Any:
        """Its space."""
        return self.acts

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Draws places and goals, with numbers that differ."""
        if seed is not None or not hasattr(self, "rng"):
            self.rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        self.places = {a: self.rng.uniform(-1, 1, 2) for a in self.agents}
        self.goals = {}
        for agent in self.agents:
            while True:
                goal = self.rng.uniform(-1, 1, 2)
                if min(abs(goal[0] - goal[1]), *np.abs(goal)) >= 0.35:
                    break
            self.goals[agent] = goal
        self.heard = {a: np.zeros(2) for a in self.agents}
        self.ways = {
            agent: Air(self.air if agent == "boat_0" else "", np.zeros(2), turns=32)
            for agent in self.agents
        }
        self.clock = 0
        return self._seen(), {agent: {} for agent in self.agents}

    def _seen(self) -> dict[str, Any]:
        found = {}
        for agent in self.possible_agents:
            other = next(each for each in self.possible_agents if each != agent)
            row = [*self.places[agent], *self.goals[other], *self.heard[agent]]
            found[agent] = np.clip(row, -2, 2).astype(np.float32)
        return found

    def step(self, actions: Any) -> Any:
        """Both sail and say at once; a boat in place stays there by steering."""
        self.clock += 1
        for agent in self.possible_agents:
            row = np.clip(np.asarray(actions[agent], np.float64), -1, 1)
            self.places[agent] = np.clip(self.places[agent] + 0.15 * row[:2], -2, 2)
            other = next(each for each in self.possible_agents if each != agent)
            self.heard[other] = np.asarray(
                self.ways[other].carried(row[2:], lambda rng: rng.uniform(-1, 1, 2), self.rng)
            )
        missing = [np.abs(self.places[a] - self.goals[a]).max() for a in self.possible_agents]
        is_done = max(missing) < REACH
        is_late = not is_done and self.clock >= self.max_cycles
        agents = self.agents
        self.agents = [] if is_done or is_late else list(agents)
        return (
            self._seen(),
            dict.fromkeys(agents, float(is_done)),
            dict.fromkeys(agents, is_done),
            dict.fromkeys(agents, is_late),
            {agent: {} for agent in agents},
        )


def boats(observation: Any, agent: str) -> Any:
    """Sails to what it hears, and says the other's goal."""
    place, goal, heard = np.split(np.asarray(observation, np.float64), 3)
    return np.clip([*(4 * (heard - place)), *goal], -1, 1).astype(np.float32)


def through(env: type, fault: str) -> type:
    """The environment with a fault of the air."""
    name = f"{env.__name__}{fault.title()}"
    return type(name, (env,), {"air": fault, "__module__": env.__module__, "__doc__": env.__doc__})
