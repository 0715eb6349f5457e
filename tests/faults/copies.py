"""Conversion to Parallel, copies and pickles."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from tests.faults import faulty
from tests.faults.lanterns import Lanterns
from tests.faults.rovers import Rovers
from tests.faults.traders import Traders


# A pickle tears views off like a deep copy does.
@faulty("GK701", also=("GK703",))
class CopyLosesAView(Rovers):
    """A deep copy's battery gauge is an array of its own, which nobody writes to.

    A view of an array, which a deep copy tears off.
    """

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The gauge is a view of the log."""
        self.log = np.zeros((2, self.count), np.float32)
        self.gauge = self.log[1]
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Writes into the log, and pays by the gauge."""
        observations, rewards, *rest = super().step(actions)
        self.log[1] += 1.0
        return observations, {a: rewards[a] + float(self.gauge[0]) for a in rewards}, *rest


@faulty("GK702")
class CopySharesTheDice(Rovers):
    """A deep copy draws from the generator of its original.

    Copies share the generator.
    """

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        """Everything is copied but the generator."""
        copied = type(self)(self.count, self.horizon, self.render_mode)
        kept = {name: value for name, value in vars(self).items() if name != "rng"}
        copied.__dict__.update(copy.deepcopy(kept, memo))
        copied.rng = self.rng
        return copied


@faulty("GK703")
class PickleForgetsTheDice(Traders):
    """A pickle leaves the generator out, and a copy begins with another one.

    The place in the random stream is lost.
    """

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the generator."""
        return {name: value for name, value in vars(self).items() if name != "rng"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """With a generator that begins anew."""
        self.__dict__.update(state)
        self.rng = np.random.default_rng(7)

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        """A deep copy keeps it."""
        copied = type(self)(self.count, self.rounds, self.render_mode)
        copied.__dict__.update(copy.deepcopy(vars(self), memo))
        return copied


@faulty("GK710")
class RotatesAllTheSame(Traders):
    """It says that it is parallelizable, and its opening trader rotates.

    The flag of an environment in cycles, without the cycles.
    """

    metadata = {**Traders.metadata, "is_parallelizable": True}  # noqa: RUF012  # as PettingZoo has it


@faulty("GK711")
class ShowsAtOnce(Lanterns):
    """It says that it is parallelizable, and what one keeper sets shows to the next.

    A wish shows before the round is settled.
    """

    def step(self, action: Any) -> None:
        """Shows the lantern at once."""
        agent = self.agent_selection
        if action is not None:
            self.level[self.possible_agents.index(agent)] = int(action)
        super().step(action)


@faulty("GK701")
class AsksItsOriginal(Rovers):
    """A function that the constructor made asks the original for the batteries.

    A deep copy keeps the function as it is, with its original in it.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.left = lambda agent: self.battery[agent]

    def info(self, agent: str) -> dict[str, Any]:
        """What the function says."""
        return {"battery": self.left(agent)}
