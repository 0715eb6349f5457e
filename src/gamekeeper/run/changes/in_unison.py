"""At some turns everybody does what one of them does, which brings conflicts about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.random import Generator

from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Change, Hooks


@dataclass(frozen=True, slots=True)
class InUnison(Change):
    """At about every second turn all do what one of them does, drawn anew each time.

    Only for agents of equal action spaces without masks. Two that do the same at once come into
    conflict far more often than two that draw: firing together, wanting one cell from both sides.
    """

    share: float = 0.5

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Unison(self.share, rng)


class _Unison(Hooks):
    def __init__(self, share: float, rng: Generator) -> None:
        self._share, self._rng = share, rng

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        if not actions or self._rng.random() >= self._share:
            return actions
        leader = list(actions)[int(self._rng.integers(len(actions)))]
        return dict.fromkeys(actions, actions[leader])
