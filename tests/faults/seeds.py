"""Seeds and generators."""

from __future__ import annotations

import random
from contextvars import ContextVar
from typing import Any

import numpy as np

from tests.faults import faulty
from tests.faults.rovers import Rovers
from tests.faults.tokens import Tokens
from tests.faults.traders import Traders


@faulty("GK600")
class ConstantGenerator(Rovers):
    """The generator is built in the constructor from a constant, and the seed is ignored.

    Every instance plays the one sequence of episodes.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.rng = np.random.default_rng(42)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Goes on with the generator that is there."""
        return super().reset(None, options)


@faulty("GK600")
class RestartedGenerator(Traders):
    """Every reset begins the generator anew from a constant: all episodes are one.

    Lots and winners are drawn, and always the same ones.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Knows the seed that was good once."""
        super().reset(7, options)


@faulty("GK601")
class Entropy(Rovers):
    """The wind comes from the system's entropy.

    The seed determines where rovers start, and not how far they come.
    """

    battery: dict[str, Any]

    def drive(self, agent: str, action: int) -> None:
        """Headwind costs more."""
        super().drive(agent, action)
        self.battery[agent] -= np.random.default_rng().random()


@faulty("GK602", also=("GK601",))
class GlobalGenerator(Traders):
    """Every second round a trader that numpy's global generator draws is given a coin.

    Luck hangs on whoever else draws in the process.
    """

    def settle(self) -> None:
        """A coin in every second round."""
        super().settle()
        if self.round % 2 == 0:
            winner = self.possible_agents[np.random.randint(self.count)]
            self.money[winner] += 1


@faulty("GK602", also=("GK601",))
class GlobalGeneratorReseeded(Rovers):
    """Every reset begins the generator of the module random anew, and the steps draw from it.

    No seed is given, so that the system chooses one.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Asks for another sequence."""
        random.seed()
        return super().reset(seed, options)

    def drive(self, agent: str, action: int) -> None:
        """Wheels spin."""
        super().drive(agent, 0 if random.random() < 0.3 else action)


@faulty("GK603")
class SeedsRandom(Rovers):
    """The reset seeds the generator of the module random, for everybody.

    Seeds whatever might be drawn from.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Seeds more than its own."""
        if seed is not None:
            random.seed(seed)
        return super().reset(seed, options)


@faulty("GK604")
class KeptSamples(Rovers):
    """Samples lie where they lay at the end of the episode before.

    What was found outlasts a reset.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Places rovers, and samples only where there are none."""
        kept = getattr(self, "samples", None)
        super().reset(seed, options)
        self.samples = kept or self.samples
        return {a: self.observation(a) for a in self.agents}, {a: self.info(a) for a in self.agents}


@faulty("GK605")
class SeedZero(Tokens):
    """Seed 0 is taken for no seed.

    Asks whether the seed is true.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """0 isn't."""
        super().reset(seed or None, options)


@faulty("GK605")
class LaterSeedZero(Tokens):
    """Seed 0 is taken for no seed in an instance that was used before.

    Asks whether the seed is true, or whether there is no generator yet.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """0 goes on drawing."""
        super().reset(seed if seed or self.rng is None else None, options)


@faulty("GK606")
class FirstSeedOnly(Traders):
    """Only the first seed of an instance is obeyed.

    A generator that is there stays.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Hands the seed on once."""
        super().reset(seed if self.rng is None else None, options)


@faulty("GK606")
class FirstSeeds(Rovers):
    """The first two seeds of an instance are obeyed, later ones aren't.

    Counts its resets.
    """

    resets = 0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Hands the seed on twice."""
        self.resets += 1
        return super().reset(seed if self.resets <= 2 else None, options)


@faulty("GK608")
class RosterOfASet(Rovers):
    """`agents` comes in the order of a set; nothing else hangs on it.

    Takes out who has ended by a set.
    """

    def step(self, actions: dict[str, Any]) -> Any:
        """The same rovers, in another order."""
        out = super().step(actions)
        self.agents = list(set(self.agents))
        return out


# A copy draws from the same generator, so the original goes on otherwise beside it.
@faulty("GK607", also=("GK702",))
class GeneratorOfTheClass(Rovers):
    """The generator belongs to the class, so that all instances draw from it.

    Whoever resets last has seeded for all.
    """

    shared: Any = None

    @property
    def rng(self) -> Any:
        """The generator of everybody."""
        return GeneratorOfTheClass.shared

    @rng.setter
    def rng(self, value: Any) -> None:
        if value is not None:
            GeneratorOfTheClass.shared = value


DICE: ContextVar[Any] = ContextVar("dice")


# A copy draws from the same generator, so the original goes on otherwise beside it.
@faulty("GK607", also=("GK702",))
class GeneratorOfTheModule(Rovers):
    """The generator belongs to the module, so that all instances draw from it.

    Whoever resets last has seeded for all.
    """

    @property
    def rng(self) -> Any:
        """The generator of everybody."""
        return DICE.get(None)

    @rng.setter
    def rng(self, value: Any) -> None:
        if value is not None:
            DICE.set(value)


@faulty("GK608")
class OrderOfASet(Rovers):
    """Rovers draw their batteries in the order of a set of their names.

    Who gets which battery hangs on the hash seed of the process.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Hands out batteries."""
        super().reset(seed, options)
        for agent in set(self.agents):
            self.battery[agent] = int(self.rng.integers(8, 30))
        return {a: self.observation(a) for a in self.agents}, {a: self.info(a) for a in self.agents}


@faulty("GK609")
class NoneReseeds(Tokens):
    """A reset without a seed takes the last one again.

    The seed is kept for later.
    """

    seed = 0

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Starts every unseeded episode alike."""
        self.seed = self.seed if seed is None else seed
        super().reset(self.seed, options)


@faulty("GK609")
class EntropyWithoutSeed(Rovers):
    """A reset without a seed takes a generator of the system's entropy.

    Each reset builds one, of None too.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """A generator of its own for each episode."""
        self.rng = np.random.default_rng(seed)
        return super().reset(None, options)


@faulty("GK601")
class UnevenStart(Rovers):
    """Under an option of the reset alone, the system's entropy says how full batteries are.

    Without the option the seed settles everything.
    """

    battery: dict[str, Any]

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Batteries are alike unless they are asked to differ."""
        super().reset(seed, options)
        if (options or {}).get("uneven", False):
            for agent in self.agents:
                self.battery[agent] -= 2 * np.random.default_rng().random()
        return {a: self.observation(a) for a in self.agents}, {a: self.info(a) for a in self.agents}


@faulty("GK616")
class OptionsStay(Rovers):
    """An option of one reset is the default of the next.

    It was kept under the name of the default.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The length of an episode is an option."""
        self.horizon = (options or {}).get("horizon", self.horizon)
        return super().reset(seed, options)


@faulty("GK616")
class FarOptionStays(OptionsStay):
    """The same of rovers with an option that only a far smaller value shows."""

    def __init__(self, horizon: int = 5000, render_mode: str | None = None) -> None:
        super().__init__(3, horizon, render_mode)
