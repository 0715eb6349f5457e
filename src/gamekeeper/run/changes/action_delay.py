"""An agent's actions are carried out so many of its turns later."""

from __future__ import annotations

import copy
from collections import deque
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.doing import Doing, Hand, does_nothing
from gamekeeper.run.stress.offer import Offer
from gamekeeper.run.stress.stressor import Stressor, Unit


@dataclass(frozen=True, slots=True)
class ActionDelay(Stressor):
    """Carries out what an agent chose some of its own turns ago.

    Until the first of them is due, and where one is illegal when it is, the declared noop stands
    in, else the first legal action. The strength is the number of turns.
    """

    label: ClassVar[Label] = "timing"
    USUAL: ClassVar[float] = 2.0
    MOST: ClassVar[float] = 10.0
    UNIT: ClassVar[Unit] = "turns"
    ON: ClassVar[Literal["seen", "done"]] = "done"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Late(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not where the environment doesn't say what an agent may do."""
        return does_nothing(contract, env, agent)


class _Late(Doing):
    def hand(self, offer: Offer, rng: Generator) -> Hand:
        turns, waiting = int(self.strength), deque[Any]()

        def do(action: Any) -> Any:
            waiting.append(copy.deepcopy(action))
            return waiting.popleft() if len(waiting) > turns else offer.stand_in(action)

        return do
