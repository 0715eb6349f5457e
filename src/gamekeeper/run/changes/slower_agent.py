"""An agent that acts only now and then."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.doing import Doing, Hand, does_nothing
from gamekeeper.run.stress.offer import Offer, offer_of
from gamekeeper.run.stress.stressor import Stressor, Unit


@dataclass(frozen=True, slots=True)
class SlowerAgent(Stressor):
    """Has an agent do nothing for some of its turns after each that it acts in.

    It does the declared noop; where that is illegal, the first legal action. The strength is the
    number of turns that it waits.
    """

    label: ClassVar[Label] = "timing"
    USUAL: ClassVar[float] = 1.0
    MOST: ClassVar[float] = 10.0
    UNIT: ClassVar[Unit] = "turns"
    ON: ClassVar[Literal["seen", "done"]] = "done"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Slow(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not to an agent without a declared noop: it can't wait."""
        offer = offer_of(contract, env, agent)
        if offer is None:
            return does_nothing(contract, env, agent)
        return None if offer.has_noop else "no action is declared that does nothing"


class _Slow(Doing):
    def hand(self, offer: Offer, rng: Generator) -> Hand:
        every, turn = int(self.strength) + 1, -1

        def do(action: Any) -> Any:
            nonlocal turn
            turn += 1
            return offer.stand_in(action) if turn % every else action

        return do
