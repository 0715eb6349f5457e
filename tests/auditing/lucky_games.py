"""Environments whose faults lie in luck or in time; light, as fresh processes import them."""

from __future__ import annotations

import functools
import sys
import time
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box, Discrete
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec
from pettingzoo.utils.wrappers import BaseWrapper
from pettingzoo.utils.wrappers.base_parallel import BaseParallelWrapper

from tests.faults.tokens import CELLS, Tokens


class Sound(ParallelEnv[str, Any, Any]):
    """Two agents see a number that their seed and the tick settle, for twenty ticks."""

    metadata: ClassVar = {"name": "sound_v0", "render_modes": []}

    def __init__(self) -> None:
        self.possible_agents, self.render_mode = ["a", "b"], None
        self.energy = 0

    @functools.cache  # noqa: B019  # as PettingZoo's documentation has it
    def observation_space(self, agent: str) -> Box:
        """A pair of numbers."""
        return Box(0.0, 1.0, (2,), np.float64)

    @functools.cache  # noqa: B019  # as PettingZoo's documentation has it
    def action_space(self, agent: str) -> Discrete:
        """Three actions."""
        return Discrete(3)

    def seen(self) -> Any:
        """What both see."""
        return self.rng.random(2)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Starts over."""
        if seed is not None or not hasattr(self, "rng"):
            self.rng = np.random.default_rng(seed)
        self.agents, self.tick = list(self.possible_agents), 0
        seen = self.seen()
        return dict.fromkeys(self.agents, seen), {agent: {} for agent in self.agents}

    def step(self, actions: Any) -> Any:
        """Counts, and pays what is seen."""
        self.tick += 1
        agents, seen, is_over = self.agents, self.seen(), self.tick >= 20
        self.agents = [] if is_over else agents
        parts: tuple[Any, ...] = (seen, float(seen[0]), False, is_over, {})
        return tuple(dict.fromkeys(agents, part) for part in parts)


class Nameless(Sound):
    """Its steps ask for a module that nobody has imported."""

    def step(self, actions: Any) -> Any:
        """What Python says of such a name."""
        raise NameError("name 'math' is not defined")


class Unseeded(Sound):
    """Draws from numpy's global generator, whatever the seed."""

    def seen(self) -> Any:
        """Luck of the process."""
        return np.random.rand(2)


class Written(Unseeded):
    """Hands out the array from which it goes on, beside the luck of the process."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Begins at zero."""
        self.at = np.zeros(2)
        seen, infos = super().reset(seed, options)
        return {**seen, "b": self.at.copy()}, infos

    def seen(self) -> Any:
        """Goes on from where it stands."""
        self.at = self.at + 0.02 * np.random.rand(2)
        return self.at

    def step(self, actions: Any) -> Any:
        """Gives the second agent an array of its own."""
        seen, *rest = super().step(actions)
        return {**seen, "b": self.at.copy()}, *rest


class AddsToItsOriginal(Sound):
    """A function of its own adds to what stands in `last`, which no call of this API hides.

    A copy has its original's function.
    """

    def __init__(self) -> None:
        super().__init__()
        self.last = 0.0
        self.add = lambda value: setattr(self, "last", self.last + value)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Begins at zero."""
        self.last = 0.0
        return super().reset(seed, options)

    def seen(self) -> Any:
        """Adds what comes up."""
        self.add(float(self.rng.random()) / 40)
        return np.array([0.5, self.last])


class JoinsWithoutInfo(Sound):
    """The second agent joins at the third tick, and has an info from the next tick on."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Begins with the first."""
        seen, infos = super().reset(seed, options)
        self.agents = ["a"]
        return {"a": seen["a"]}, {"a": infos["a"]}

    def step(self, actions: Any) -> Any:
        """Lets the second one in."""
        if self.tick == 2:
            self.agents.append("b")
        *parts, infos = super().step(actions)
        return *parts, {agent: infos[agent] for agent in actions}


class Slips(Sound):
    """One observation in ten hangs on a generator that nobody seeded."""

    def seen(self) -> Any:
        """A slip now and then."""
        return np.array([0.5, float(np.random.default_rng().random() < 0.1)])


class Noise(Sound):
    """Every observation hangs on a generator that nobody seeded."""

    def seen(self) -> Any:
        """Luck."""
        return np.random.default_rng().random(2)


class Tires(Sound):
    """What is left of the energy stays over a reset; nothing is drawn."""

    def seen(self) -> Any:
        """Less at each call."""
        self.energy += 1
        return np.array([1.0 / self.energy, 0.0])


class AddsUp(Sound):
    """Steps are counted over resets; after fifty, in a third episode, what is seen is another."""

    def seen(self) -> Any:
        """Half of what was drawn once the count is up."""
        self.energy += 1
        return self.rng.random(2) / (1 + (self.energy > 50))


class LentRoster(Sound):
    """From its second episode on, agents that end are taken out of the possible agents too."""

    episodes = 0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Copies the list once."""
        out = super().reset(seed, options)
        self.episodes += 1
        self.agents = self.possible_agents if self.episodes > 1 else list(self.possible_agents)
        return out

    def step(self, actions: Any) -> Any:
        """One of the two ends early."""
        out = super().step(actions)
        if self.tick == 5 and "b" in self.agents:
            out[2]["b"] = True
            self.agents.remove("b")
        return out


class Drifts(Sound):
    """Goes on, over resets, from draws of the process and of a generator that nobody seeded."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Never begins anew."""
        self.own = getattr(self, "own", None) or np.random.default_rng()
        return super().reset(seed, options)

    def seen(self) -> Any:
        """One number of each."""
        return np.array([self.own.random(), np.random.rand()])


class Remembers(Sound):
    """A default argument is filled by the first reset, and every later instance finds it so."""

    def reset(self, seed: int | None = None, options: Any = None, kept: Any = []) -> Any:  # noqa: B006  # the fault
        """Begins with what is there."""
        self.begun = float(bool(kept))
        kept.append(seed)
        return super().reset(seed, options)

    def seen(self) -> Any:
        """Whether somebody was there before."""
        return np.array([self.begun, 0.5])


class Leaps(Sound):
    """Observations leave their space now and then, by numpy's global generator."""

    def seen(self) -> Any:
        """Outside the space, once in some turns."""
        return np.array([2.0 if np.random.rand() < 0.2 else 0.5, 0.5])


class OnlyInTests(Sound):
    """Observations leave their space where pytest is loaded, and in no reproducer's process."""

    def seen(self) -> Any:
        """Outside the space, or not."""
        return np.array([2.0 if "pytest" in sys.modules else 0.5, 0.5])


class Slow(Sound):
    """A step takes 20 ms of a clock that nothing else moves."""

    clock_s = 0.0

    def step(self, actions: Any) -> Any:
        """Takes its time."""
        Slow.clock_s += 0.02
        return super().step(actions)


class Stuck(Sound):
    """Its third step never returns."""

    def step(self, actions: Any) -> Any:
        """Waits for what doesn't come."""
        while self.tick == 2:
            time.sleep(0.1)
        return super().step(actions)


class Lingers(Sound):
    """An agent that ends early stays in `agents`, and is paid as long as it does."""

    def step(self, actions: Any) -> Any:
        """Ends one after five ticks."""
        out = super().step(actions)
        if "a" in out[2]:
            out[2]["a"], out[3]["a"] = self.tick >= 5, False
        return out


class PaidWhenGone(Lingers):
    """The same, paid by possible_agents: also where it is out of `agents`."""

    def step(self, actions: Any) -> Any:
        """Pays both."""
        out = super().step(actions)
        out[1].update(dict.fromkeys(self.possible_agents, 0.5))
        return out


class Sinks(Lingers):
    """The same, seen below the space once it has ended."""

    at = 6
    """The first tick at which it is."""

    def step(self, actions: Any) -> Any:
        """Changes what one of them sees."""
        out = super().step(actions)
        if "a" in out[0] and self.tick >= self.at:
            out[0]["a"] = out[0]["a"] - 1.0
        return out


class SinksAsItEnds(Sinks):
    """The same, also in the step that ends it."""

    at = 5


@dataclass(frozen=True)
class Walker:
    """An agent that equals those of its number."""

    number: int


class Numbered(Sound):
    """Agents are values that aren't texts."""

    def __init__(self) -> None:
        super().__init__()
        # agents that are no texts, which is what these games are about
        self.possible_agents = [Walker(0), Walker(1)]  # type: ignore[list-item]


class Vanishes(Numbered):
    """One leaves `agents` without a flag."""

    def step(self, actions: Any) -> Any:
        """Takes it out after five ticks."""
        out = super().step(actions)
        self.agents = self.agents[: 1 if self.tick >= 5 else 2]
        return out


class FirstIsPaid(Numbered):
    """Pays whichever agent stands first in the dictionary of actions."""

    def step(self, actions: Any) -> Any:
        """Pays more to one."""
        out = super().step(actions)
        out[1][next(iter(actions))] += 1.0
        return out


class Dims(BaseParallelWrapper[str, Any, Any]):
    """A wrapper that shows half of everything once it was played, in later episodes too."""

    factor = 1.0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Shows what the episode before has left."""
        seen, infos = super().reset(seed, options)
        return {agent: self.factor * each for agent, each in seen.items()}, infos

    def step(self, actions: Any) -> Any:
        """Is played from now on."""
        self.factor = 0.5
        seen, *others = super().step(actions)
        return {agent: self.factor * each for agent, each in seen.items()}, *others


def dimmed() -> BaseParallelWrapper[str, Any, Any]:
    """Sound rules in three wrappers, of which the middle one isn't."""
    return BaseParallelWrapper(Dims(BaseParallelWrapper(Sound())))


def wrapped_tires() -> BaseParallelWrapper[str, Any, Any]:
    """Faulty rules in a sound wrapper."""
    return BaseParallelWrapper(Tires())


class OwnRoster(BaseWrapper[str, Any, Any]):
    """Keeps a list of agents of its own, from which nobody is taken."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Fills it."""
        super().reset(seed, options)
        self.agents = list(self.env.agents)


def with_own_roster() -> BaseWrapper[str, Any, Any]:
    """A clean environment in it."""
    return OwnRoster(Tokens())


class Jammed(Tokens):
    """Half of the cells are blocked at each turn, by no seed; the twentieth step raises."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Another game each time."""
        super().reset(None, options)
        self.placed, self.open = 0, self.rng.permutation(CELLS) < CELLS // 2

    def legal(self) -> Any:
        """Cells that aren't blocked."""
        return self.open.astype(np.int8)

    def step(self, action: Any) -> None:
        """Says that a blocked cell is taken; nobody wins."""
        if not self.open[int(action)]:
            raise ValueError(f"cell {action} is taken")
        self.placed, self.open = self.placed + 1, self.rng.permutation(CELLS) < CELLS // 2
        if self.placed == 20:
            raise RuntimeError("jammed")
        self.agent_selection = next(each for each in self.agents if each != self.agent_selection)


class Pushed(Sound):
    """Pays each agent the push that it gives, and keeps no action."""

    @functools.cache  # noqa: B019  # as PettingZoo's documentation has it
    def action_space(self, agent: str) -> Any:
        """A push."""
        return Box(-1.0, 1.0, (1,), np.float32)

    def step(self, actions: Any) -> Any:
        """Pays what was pushed."""
        seen, _, *others = super().step(actions)
        return seen, {agent: float(actions[agent][0]) for agent in seen}, *others


def converted() -> AECEnv[str, Any, Any]:
    """Sound rules in PettingZoo's converter."""
    return parallel_to_aec(Pushed())


def imported_late() -> Any:
    """An environment of a module that is imported as the first one is built."""
    return import_module("tests.auditing.drawn_at_import").Sampled()
