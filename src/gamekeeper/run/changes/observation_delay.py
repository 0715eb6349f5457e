"""An agent sees what was so many of its turns ago."""

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
from gamekeeper.run.stress.seeing import Eye, Seeing, Sight, sees_nothing
from gamekeeper.run.stress.stressor import Stressor, Unit


@dataclass(frozen=True, slots=True)
class ObservationDelay(Stressor):
    """Shows an agent what it was given some of its own turns ago; at first, what came first.

    The mask is that of now. The strength is the number of turns.
    """

    label: ClassVar[Label] = "perception"
    USUAL: ClassVar[float] = 2.0
    MOST: ClassVar[float] = 10.0
    UNIT: ClassVar[Unit] = "turns"
    ON: ClassVar[Literal["seen", "done"]] = "seen"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Late(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not to an agent that sees nothing anyway."""
        return sees_nothing(contract, env, agent)


class _Late(Seeing):
    def eye(self, sight: Sight, rng: Generator) -> Eye:
        seen: deque[Any] = deque(maxlen=int(self.strength) + 1)

        def see(observation: Any) -> Any:
            seen.append(copy.deepcopy(observation))
            return sight.as_now(seen[0], observation)

        return see
