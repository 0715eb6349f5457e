"""Each agent holds an action for a while, and so comes further than one that dithers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.random import Generator

from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Change, Hooks


@dataclass(frozen=True, slots=True)
class Held(Change):
    """Actions are held; only where every action is legal at every turn.

    Attributes:
        turns: for how long, on average.
    """

    turns: int = 12

    def start(self, rng: Generator) -> Hooks:
        """An agent takes another action with probability 1 / turns."""
        return _Holding(rng, self.turns)


class _Holding(Hooks):
    def __init__(self, rng: Generator, turns: int) -> None:
        self._rng, self._turns = rng, turns
        self._held: dict[AgentId, Any] = {}

    def acts(self, turn: int, actions: Mapping[AgentId, Any]) -> dict[AgentId, Any]:
        """What is held in place of what was chosen."""
        done: dict[AgentId, Any] = {}
        for agent, action in actions.items():
            is_new = agent not in self._held or self._rng.random() * self._turns < 1
            if is_new and action is not None:
                self._held[agent] = action
            done[agent] = None if action is None else self._held[agent]
        return done
