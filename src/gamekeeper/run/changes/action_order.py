"""The same joint action, handed over in another order of its dictionary."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from numpy.random import Generator

from gamekeeper.core.failure_label import Label
from gamekeeper.game.door import AgentId
from gamekeeper.run.change import Change, Hooks

ORDERS: Final[dict[str, str]] = {
    "reversed": "agents[::-1]",
    "rotated": "agents[1:] + agents[:1]",
    "shuffled": "random.Random(turn).sample(agents, len(agents))",
}
"""Every order as an expression over `agents` and `turn`, as a program may have it."""


@dataclass(frozen=True, slots=True)
class ActionOrder(Change):
    """The same actions at every turn, in another order of the dictionary.

    Attributes:
        order: `reversed` (every pair of agents changes its places), `rotated` (the first goes to
            the end), `shuffled` (another order at every turn).
    """

    label: ClassVar[Label] = "timing"

    order: str = "reversed"

    def start(self, rng: Generator) -> Hooks:
        """The hooks for one play."""
        return _Reordered(self.order)


class _Reordered(Hooks):
    def __init__(self, order: str) -> None:
        self._order = order

    def acts(self, turn: int, actions: dict[AgentId, Any]) -> dict[AgentId, Any]:
        return {agent: actions[agent] for agent in reordered(self._order, list(actions), turn)}


def reordered(order: str, agents: Sequence[AgentId], turn: int) -> list[AgentId]:
    """The agents in the order of that name.

    Raises:
        KeyError: there is no such order.
    """
    listed = list(agents)
    if order == "reversed":
        return listed[::-1]
    if order == "rotated":
        return listed[1:] + listed[:1]
    if order == "shuffled":
        return random.Random(turn).sample(listed, len(listed))
    raise KeyError(order)
