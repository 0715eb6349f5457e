"""Calls that change more than they say: arguments, generators, rewards."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from tests.faults import faulty
from tests.faults.lanterns import Lanterns
from tests.faults.rovers import Rovers
from tests.faults.traders import Traders


@faulty("GK630")
class ActionsTakenOut(Rovers):
    """step takes the actions out of the caller's dictionary.

    The caller's dictionary is emptied.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """Pops each action."""
        return super().step({agent: actions.pop(agent) for agent in list(actions)})


@faulty("GK631")
class ActionsKept(Rovers):
    """step keeps the caller's dictionary and reads it at the next step.

    A turn on the spot costs battery, by the actions that were kept.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nobody has driven."""
        self.before: dict[str, Any] = {}
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Whoever drives on in the same manner saves battery."""
        for agent in self.agents:
            self.battery[agent] += self.before.get(agent) == actions[agent]
        self.before = actions
        return super().step(actions)


@faulty("GK632")
class OptionsFilledIn(Rovers):
    """reset writes its defaults into the caller's options.

    The caller's options are filled in.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Notes the horizon in the options."""
        if options is not None:
            options.setdefault("horizon", self.horizon)
        return super().reset(seed, options)


# Policies ask for spaces, and a replay from script doesn't: the same actions go another way.
@faulty("GK633", also=("GK607",))
class SpacesDraw(Rovers):
    """action_space() draws a seed for the space from the game's generator.

    Asking for a space draws.
    """

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The same object, seeded at every call."""
        if self.rng is not None:
            self._done[agent].seed(int(self.rng.integers(1000)))
        return self._done[agent]


@faulty("GK634")
class ObserveDraws(Traders):
    """observe() draws its noise from the game's generator.

    Each look at the purses draws.
    """

    def observe(self, agent: str) -> Any:
        """The purses, not quite exactly; the same look twice shows the same, and draws twice."""
        seen = super().observe(agent)
        if agent != self.agent_selection:
            self.rng.random()
        return seen


# last() looks too.
@faulty("GK634", also=("GK635",))
class EachLookDraws(Traders):
    """observe() draws from the game's generator whoever looks.

    Noise is drawn, and not used.
    """

    def observe(self, agent: str) -> Any:
        """The purses, exactly."""
        self.rng.random()
        return super().observe(agent)


# last() looks too, and what is drawn for it is drawn from what others draw from.
@faulty("GK602", "GK634", also=("GK601", "GK609", "GK635"))
class EachLookDrawsGlobally(Traders):
    """observe() draws its noise from a global generator, which reset seeds.

    What is seen isn't quite exact.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Seeds the generator of all."""
        np.random.seed(seed)
        super().reset(seed, options)

    def observe(self, agent: str) -> Any:
        """The purses, not quite exactly."""
        seen = super().observe(agent)
        return np.clip(seen + np.random.normal(0, 0.1), 0.0, 1.0).astype(seen.dtype)


# Who is asked twice in a turn tells a sum of rewards that isn't the sum.
@faulty("GK635", also=("GK403",))
class LastPaysOut(Traders):
    """last() pays the agent's rewards out: who asks again is told 0.

    Asking clears what was earned.
    """

    def last(self, observe: bool = True) -> Any:
        """Clears what it tells."""
        told = super().last(observe)
        self._cumulative_rewards[self.agent_selection] = 0.0
        return told


# Two looks at the state of one turn differ by the fog.
@faulty("GK636", also=("GK814",))
class StateDraws(Lanterns):
    """state() draws its noise from the game's generator.

    Each look at the state draws.
    """

    def state(self) -> Any:
        """The lanterns, as one sees them in the fog."""
        fog = self.rng.normal(0.0, 0.01, self.count)
        return np.clip(super().state() + fog, 0.0, 1.0).astype(np.float32)


# It draws in a mode as it does without one.
@faulty("GK637", also=("GK805",))
class RenderDraws(Rovers):
    """render() draws from the game's generator, whatever the mode.

    Each picture draws.
    """

    def render(self) -> Any:
        """Dust in the picture."""
        self.rng.random()
        return super().render()


@faulty("GK638", also=("GK609",))
class SpaceIsTheDice(Rovers):
    """The wind is drawn by sampling from the space of actions that is handed out.

    The spaces' generators are the game's dice.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Seeds the spaces too."""
        for place, agent in enumerate(self.possible_agents):
            self._done[agent].seed(None if seed is None else seed + place)
        return super().reset(seed, options)

    def drive(self, agent: str, action: int) -> None:
        """Now and then somewhere else than was wished."""
        drift = int(self._done[agent].sample())
        super().drive(agent, drift if drift == 1 else action)


@faulty("GK639")
class NameCounts(Rovers):
    """str(env) draws from the game's generator, for a name that nobody has.

    Asking for the name draws.
    """

    def __str__(self) -> str:
        """A name with a number."""
        number = 0 if self.rng is None else int(self.rng.integers(100))
        return f"rovers {number}"
