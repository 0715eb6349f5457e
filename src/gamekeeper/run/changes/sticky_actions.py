"""Actions that stick: what was done before is done once more."""

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
class StickyActions(Stressor):
    """Repeats at some turns what the agent did at the turn before.

    Where that is illegal now, the declared noop stands in, else the first legal action. The
    strength is the probability at each turn.

    Source: Machado et al. 2018, "Revisiting the Arcade Learning Environment" (there 0.25).
    """

    label: ClassVar[Label] = "control"
    USUAL: ClassVar[float] = 0.5
    ON: ClassVar[Literal["seen", "done"]] = "done"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Sticking(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not where the environment doesn't say what an agent may do."""
        return does_nothing(contract, env, agent)


class _Sticking(Doing):
    def hand(self, offer: Offer, rng: Generator) -> Hand:
        strength, last = self.strength, None

        def do(action: Any) -> Any:
            nonlocal last
            if rng.random() < strength and last is not None:
                done = copy.deepcopy(last)
                last = last if offer.allows(done) else offer.stand_in(action)
                return done
            last = copy.deepcopy(action)
            return action

        return do
