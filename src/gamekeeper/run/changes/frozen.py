"""An agent that does the same for ever."""

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
class Frozen(Stressor):
    """Repeats an agent's first action in place of what it chooses.

    Where that is illegal, the declared noop stands in, else the first legal action. The strength is
    the probability at each turn; at 1 nothing is left of the agent's plan but its first action.
    """

    label: ClassVar[Label] = "planning"
    USUAL: ClassVar[float] = 1.0
    ON: ClassVar[Literal["seen", "done"]] = "done"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Repeating(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not where the environment doesn't say what an agent may do."""
        return does_nothing(contract, env, agent)


class _Repeating(Doing):
    def hand(self, offer: Offer, rng: Generator) -> Hand:
        strength, first = self.strength, list[Any]()

        def do(action: Any) -> Any:
            is_struck = rng.random() < strength
            if not first:
                first.append(copy.deepcopy(action))
                return action
            return copy.deepcopy(first[0]) if is_struck else action

        return do
