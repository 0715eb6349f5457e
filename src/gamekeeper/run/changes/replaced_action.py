"""One agent's action at one turn, replaced by another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.random import Generator

from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Change, Hooks


@dataclass(frozen=True, slots=True)
class ReplacedAction(Change):
    """One agent does something else at one turn; everybody else does what they did.

    Attributes:
        turn: at which; nothing changes where the agent doesn't act then.
        agent: who.
        action: what it does instead.
    """

    turn: int
    agent: AgentId
    action: Any

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Replaced(self)


class _Replaced(Hooks):
    def __init__(self, change: ReplacedAction) -> None:
        self._change = change

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        change = self._change
        if turn != change.turn or actions.get(change.agent) is None:
            return actions
        return {**actions, change.agent: change.action}
