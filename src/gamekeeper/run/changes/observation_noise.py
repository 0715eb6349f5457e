"""Noise on every number that an agent sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.numbers import numbers_of
from gamekeeper.run.stress.seeing import Eye, Seeing, Sight, sees_no_numbers
from gamekeeper.run.stress.stressor import Stressor, Unit


@dataclass(frozen=True, slots=True)
class ObservationNoise(Stressor):
    """Adds a normal number to each number that an agent sees, drawn anew at every turn.

    Whole numbers are rounded, and all stay in the space. The mask is left alone. The strength is
    the standard deviation as a part of the number's declared range; where no bounds are declared
    (or they are more than 1e9 apart), of the span of what the agent has seen there so far, 0
    counted.
    """

    label: ClassVar[Label] = "perception"
    USUAL: ClassVar[float] = 0.2
    MOST: ClassVar[float] = 2.0
    UNIT: ClassVar[Unit] = "deviation"
    ON: ClassVar[Literal["seen", "done"]] = "seen"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Noisy(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not to an agent that sees no numbers."""
        return sees_no_numbers(contract, env, agent)


class _Noisy(Seeing):
    def eye(self, sight: Sight, rng: Generator) -> Eye:
        numbers, strength = numbers_of(sight.parts), self.strength

        def see(observation: Any) -> Any:
            for each in numbers:
                noise = rng.standard_normal(each.size)
                found = each.read(observation)
                if found is not None:
                    noisy = found + strength * each.width * noise
                    observation = each.write(observation, noisy)
            return observation

        return see
