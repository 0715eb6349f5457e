"""Rovers are steered by objects that only live in this process."""

from __future__ import annotations

from typing import Any

from gymnasium import spaces

from gamekeeper.audit.specimens._rovers import MOVES, Rovers

BREAKS = ("GK901",)
ALSO = ("GK608",)
"""Another process can't be told of objects either."""


class Order:
    """Where to go."""

    def __init__(self, move: int) -> None:
        self.move = move


class Orders(spaces.Space[Any]):
    """A space of orders."""

    def sample(self, mask: Any = None, probability: Any = None) -> Any:
        """Any order."""
        return Order(int(self.np_random.integers(len(MOVES))))

    def contains(self, x: Any) -> bool:
        """Whether it is an order."""
        return isinstance(x, Order)


class OrdersAreObjects(Rovers):
    """Rovers that take orders."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._done = {agent: Orders() for agent in self.possible_agents}  # type: ignore[misc]

    def step(self, actions: dict[str, Any]) -> Any:
        """Does as ordered."""
        return super().step({agent: order.move for agent, order in actions.items()})


def make(**kwargs: Any) -> OrdersAreObjects:
    """The environment with its one fault."""
    return OrdersAreObjects(**kwargs)
