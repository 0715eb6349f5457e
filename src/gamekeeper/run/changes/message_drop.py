"""Messages that don't arrive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.seeing import Eye, Seeing, Sight, blinder, hears_nothing
from gamekeeper.run.stress.stressor import Stressor


@dataclass(frozen=True, slots=True)
class MessageDrop(Stressor):
    """Blanks what is told to an agent at some turns: the declared message fields that it sees.

    The agents are those that listen. Blank are zeros, or what the space has that is nearest to
    them; no text. The strength is the probability at each turn.
    """

    label: ClassVar[Label] = "perception"
    USUAL: ClassVar[float] = 0.5
    ON: ClassVar[Literal["seen", "done"]] = "seen"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Deaf(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not to an agent without a declared message field among what it sees."""
        return hears_nothing(contract, env, agent)


class _Deaf(Seeing):
    def eye(self, sight: Sight, rng: Generator) -> Eye:
        deafen, strength = blinder(sight.messages), self.strength
        return lambda observation: deafen(observation) if rng.random() < strength else observation
