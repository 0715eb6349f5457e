"""Actions and agents that evidence can't name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gymnasium import spaces

from tests.faults import clean, faulty
from tests.faults.rovers import MOVES, Rovers


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


@faulty("GK901")
class OrdersAreObjects(Rovers):
    """Rovers are steered by objects that only live in this process.

    Rovers that take orders.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._done = {agent: Orders() for agent in self.possible_agents}  # type: ignore[misc]

    def step(self, actions: dict[str, Any]) -> Any:
        """Does as ordered."""
        return super().step({agent: order.move for agent, order in actions.items()})


# In evidence, which knows agents by their text, the two are one: it lives on when either ends.
@faulty("GK902", also=("GK402", "GK503"))
class NumberAndText(Rovers):
    """One player is called 1, the other "1".

    Two rovers whose names look alike.
    """

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(count=2, render_mode=render_mode)
        renamed(self, [1, "1"])


class Rover:
    """A rover that equals itself alone."""


@dataclass(frozen=True)
class NumberedRover:
    """A rover that equals those of its number."""

    number: int


def renamed(env: Rovers, names: list[Any]) -> None:
    """Gives the agents these names."""
    env._seen = dict(zip(names, env._seen.values(), strict=True))
    env._done = dict(zip(names, env._done.values(), strict=True))
    env.possible_agents = names


@faulty("GK902")
class RoversAreObjects(Rovers):
    """An agent of one instance is none of another one's.

    Rovers that are called by themselves.
    """

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(count=2, render_mode=render_mode)
        renamed(self, [Rover(), Rover()])


class NamedRover(Rover):
    """A rover that equals itself alone, and says its name."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __repr__(self) -> str:
        return self.name


@faulty("GK902")
class RoversWithNames(Rovers):
    """Agents of two instances have one text, and aren't equal.

    Rovers that are called by themselves, and say their names.
    """

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(count=2, render_mode=render_mode)
        renamed(self, [NamedRover("north"), NamedRover("south")])


@clean()
class RoversAreNumbered(Rovers):
    """Agents are values that aren't texts."""

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(count=2, render_mode=render_mode)
        renamed(self, [NumberedRover(1), NumberedRover(2)])
