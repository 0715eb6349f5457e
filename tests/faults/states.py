"""`state()`."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.faults import faulty
from tests.faults.rovers import Rovers
from tests.faults.traders import Traders


@faulty("GK811")
class StateOfTheLiving(Rovers):
    """The state has rows for live rovers only."""

    def state(self) -> Any:
        """Shorter whenever a rover has ended."""
        rows = [self.cells[a] / 5 for a in self.agents] + [self.samples[a] / 5 for a in self.agents]
        return np.concatenate(rows or [np.zeros(0)]).astype(np.float32)


@faulty("GK812")
class StateFloat64(Traders):
    """The state has more digits than its space."""

    def state(self) -> Any:
        """As float64."""
        return super().state().astype(np.float64)


@faulty("GK813")
class StateUnscaled(Rovers):
    """The state is in cells, its space in parts of the torus."""

    def state(self) -> Any:
        """Not divided by the size."""
        return super().state() * np.float32(5)


@faulty("GK814")
class StateWithNoise(Rovers):
    """The state has a noise of its own."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The noise begins anew."""
        self.noise = np.random.default_rng(0)
        return super().reset(seed, options)

    def state(self) -> Any:
        """A little less than it is."""
        return (super().state() * self.noise.uniform(0.9, 1.0)).astype(np.float32)


# What outlives a reset also parts a second episode from a first one.
@faulty("GK815", also=("GK604",))
class StateOutlivesReset(Rovers):
    """The state is kept until the next step, also over a reset."""

    kept: Any = None

    def step(self, actions: dict[str, Any]) -> Any:
        """The state is another now."""
        self.kept = None
        return super().step(actions)

    def state(self) -> Any:
        """Made once a turn."""
        if self.kept is None:
            self.kept = super().state()
        return self.kept.copy()


@faulty("GK816")
class StateOfTheStart(Rovers):
    """The state is that of the reset."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Keeps the state."""
        out = super().reset(seed, options)
        self.kept = super().state()
        return out

    def state(self) -> Any:
        """As it was."""
        return self.kept.copy()


@faulty("GK817")
class StateATickLate(Rovers):
    """The state is the one before the tick."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Keeps the state."""
        out = super().reset(seed, options)
        self.kept = super().state()
        return out

    def step(self, actions: dict[str, Any]) -> Any:
        """Keeps the state, and goes on."""
        self.kept = super().state()
        return super().step(actions)

    def state(self) -> Any:
        """As it was before the tick."""
        return self.kept.copy()


@faulty("GK818")
class StateNeedsEverybody(Rovers):
    """There is no state once a rover has ended."""

    def state(self) -> Any:
        """Knows the cells of live rovers only."""
        cells = {agent: self.cells[agent] for agent in self.agents}
        rows = [cells[agent] / 5 for agent in self.possible_agents]
        rows += [self.samples[agent] / 5 for agent in self.possible_agents]
        return np.concatenate(rows).astype(np.float32)
