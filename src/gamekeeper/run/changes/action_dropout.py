"""Actions that aren't carried out."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.doing import Doing, Hand, does_nothing
from gamekeeper.run.stress.offer import Offer
from gamekeeper.run.stress.stressor import Stressor


@dataclass(frozen=True, slots=True)
class ActionDropout(Stressor):
    """Has an agent do nothing at some turns, whatever it chose.

    It does the declared noop; where none is declared, what it last did of its own choice (at first,
    what it chooses). What is illegal now gives way to the noop, else to the first legal action. The
    strength is the probability at each turn.
    """

    label: ClassVar[Label] = "control"
    USUAL: ClassVar[float] = 0.5
    ON: ClassVar[Literal["seen", "done"]] = "done"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Dropping(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not where the environment doesn't say what an agent may do."""
        return does_nothing(contract, env, agent)


class _Dropping(Doing):
    def hand(self, offer: Offer, rng: Generator) -> Hand:
        strength, last = self.strength, None

        def do(action: Any) -> Any:
            nonlocal last
            if rng.random() >= strength:
                last = copy.deepcopy(action)
                return action
            if offer.has_noop:
                return offer.noop(action)
            return action if last is None else copy.deepcopy(last)

        return do
