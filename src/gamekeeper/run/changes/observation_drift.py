"""An offset on every number that an agent sees, which wanders from turn to turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.numbers import numbers_of
from gamekeeper.run.stress.seeing import Eye, Seeing, Sight, sees_no_numbers
from gamekeeper.run.stress.stressor import Stressor, Unit


@dataclass(frozen=True, slots=True)
class ObservationDrift(Stressor):
    """Adds to each number that an agent sees an offset that takes a normal step at every turn.

    A random walk from 0 that nothing brings back: after n turns its deviation is the strength times
    the root of n. Whole numbers are rounded, and all stay in the space; the mask is left alone. The
    strength is the deviation of a step as a part of the number's declared range; where no bounds
    are declared, of the span of what the agent has seen there so far, 0 counted.
    """

    label: ClassVar[Label] = "state estimation"
    USUAL: ClassVar[float] = 0.05
    MOST: ClassVar[float] = 0.5
    UNIT: ClassVar[Unit] = "deviation"
    ON: ClassVar[Literal["seen", "done"]] = "seen"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Drifting(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not to an agent that sees no numbers."""
        return sees_no_numbers(contract, env, agent)


class _Drifting(Seeing):
    def eye(self, sight: Sight, rng: Generator) -> Eye:
        walks = [(each, np.zeros(each.size)) for each in numbers_of(sight.parts)]
        strength = self.strength

        def see(observation: Any) -> Any:
            for each, walk in walks:
                walk += rng.standard_normal(each.size)
                found = each.read(observation)
                if found is not None:
                    drifted = found + strength * each.width * walk
                    observation = each.write(observation, drifted)
            return observation

        return see
