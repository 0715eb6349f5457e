"""Turns at which an agent sees nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.seeing import Eye, Seeing, Sight, blinder, sees_nothing
from gamekeeper.run.stress.stressor import Stressor


@dataclass(frozen=True, slots=True)
class ObservationDropout(Stressor):
    """Blanks all that an agent sees at some turns, each by itself.

    Blank are zeros, or what the space has that is nearest to them; no text, no items. The mask is
    left alone. The strength is the probability at each turn.
    """

    label: ClassVar[Label] = "perception"
    USUAL: ClassVar[float] = 0.5
    ON: ClassVar[Literal["seen", "done"]] = "seen"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Dropping(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not to an agent that sees nothing anyway."""
        return sees_nothing(contract, env, agent)


class _Dropping(Seeing):
    def eye(self, sight: Sight, rng: Generator) -> Eye:
        blind, strength = blinder(sight.parts), self.strength
        return lambda observation: blind(observation) if rng.random() < strength else observation
