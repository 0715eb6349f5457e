"""Actions that their giver writes into once the step is over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.random import Generator

from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Change, Hooks
from gamekeeper.run.handed import overwrite


@dataclass(frozen=True, slots=True)
class ActionsOverwritten(Change):
    """Overwrites the arrays of actions after the step that they were for, and empties their dict.

    A learner re-uses its buffers like that; an environment that kept a reference reads them late.
    """

    def start(self, rng: Generator) -> Hooks:
        """The hooks; they draw nothing."""
        return _Overwriting()


class _Overwriting(Hooks):
    def __init__(self) -> None:
        self._given: dict[AgentId, Any] = {}

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        """Remembers the very objects that are handed over."""
        self._given = actions
        return actions

    def between(self, turn: int, env: Any) -> None:
        """Writes into them."""
        for action in self._given.values():
            overwrite(action)
        self._given.clear()
