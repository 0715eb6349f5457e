"""Stretches during which an agent sees nothing new."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.errors import SpecError
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.seeing import Eye, Seeing, Sight, sees_nothing
from gamekeeper.run.stress.stressor import Stressor


@dataclass(frozen=True, slots=True)
class StaleMemory(Stressor):
    """Shows an agent again and again what it saw before, for bursts of turns.

    The mask is that of now. The strength is the probability, at each turn outside a burst, that one
    begins; during a burst the agent sees what it saw at the turn before it. The first turn is never
    stale, and neither is the one between two bursts.

    Attributes:
        turns: how many of the agent's own turns a burst lasts, from 1.
    """

    label: ClassVar[Label] = "state estimation"
    USUAL: ClassVar[float] = 0.25
    ON: ClassVar[Literal["seen", "done"]] = "seen"

    strength: float = USUAL
    turns: int = 5

    def __post_init__(self) -> None:
        Stressor.__post_init__(self)
        if self.turns < 1:
            raise SpecError(
                "a burst can't be that short", where="turns", expected=">= 1", seen=str(self.turns)
            )

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Stale(self, rng, self.turns) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not to an agent that sees nothing anyway."""
        return sees_nothing(contract, env, agent)


class _Stale(Seeing):
    def __init__(self, change: Stressor, rng: Generator, turns: int) -> None:
        super().__init__(change, rng)
        self._turns = turns

    def eye(self, sight: Sight, rng: Generator) -> Eye:
        strength, turns = self.strength, self._turns
        left, memory = 0, None

        def see(observation: Any) -> Any:
            nonlocal left, memory
            is_struck = rng.random() < strength
            if left > 1:
                left -= 1
            elif left == 0 and is_struck and memory is not None:
                left = turns
            else:
                left, memory = 0, copy.deepcopy(observation)
                return observation
            return sight.as_now(memory, observation)

        return see
