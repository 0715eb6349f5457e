"""Agents whose actions stand last in the dictionary of a tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from numpy.random import Generator

from gamekeeper.core.contract import Contract
from gamekeeper.core.failure_label import Label
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Hooks
from gamekeeper.run.stress.stressor import Stress, Stressor


@dataclass(frozen=True, slots=True)
class LaterPlace(Stressor):
    """Moves agents to the end of a tick's actions, or to its beginning where they end it already.

    Nobody does anything else: only what hangs on the order within a tick is changed. With everybody
    named, the order is turned round. The strength is the probability at each tick.
    """

    label: ClassVar[Label] = "timing"
    USUAL: ClassVar[float] = 1.0
    ON: ClassVar[Literal["seen", "done"]] = "done"

    strength: float = USUAL

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Moved(self, rng) if self.strength else Hooks()

    @classmethod
    def applies(cls, contract: Contract, env: Any, agent: AgentId) -> str | None:
        """Not where agents act one at a time, nor to one that is alone."""
        if hasattr(env, "agent_iter"):
            return "one agent acts at a time, so there is no order within a tick"
        is_alone = len(getattr(env, "possible_agents", ())) == 1
        return "there is no other agent" if is_alone else None


class _Moved(Stress):
    def __init__(self, change: Stressor, rng: Generator) -> None:
        super().__init__(change, rng)
        self._rng = self.stream("order")

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        if self._rng.random() >= self.strength:
            return actions
        moved = [agent for agent in actions if self.is_meant(agent)]
        others = [agent for agent in actions if not self.is_meant(agent)]
        order = others + moved
        if order == list(actions):
            order = moved + others if others else moved[::-1]
        return {agent: actions[agent] for agent in order}
