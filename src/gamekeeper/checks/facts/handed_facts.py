"""Facts of the probes `kept`, `handed_over`, `written` and `extra_calls`."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class ChangedValue:
    """A value that changed after it was handed out.

    Attributes:
        given: the turn at which it was handed out.
        seen: the turn at which the change was seen.
        agent: whose; None for the dictionary itself.
    """

    given: int
    seen: int
    agent: Any


@dataclass(frozen=True, slots=True)
class ChangedArgument:
    """An argument that changed in a call, and whose it is; None for the dictionary itself."""

    agent: Any
    before: Any
    after: Any


@dataclass(frozen=True, slots=True)
class KeptValues:
    """Values of one kind (the field) that were handed out and looked at later; the first change."""

    looks: int
    changed: ChangedValue | None


@dataclass(frozen=True, slots=True)
class SharedValues:
    """Values of one kind (the field) that agents were given at one turn.

    Attributes:
        looks: at pairs.
        shared: pairs that were given the same memory.
        pair: the first of them.
    """

    looks: int
    shared: int
    pair: tuple[Any, Any] | None


@dataclass(frozen=True, slots=True)
class HandedActions:
    """Actions after each step, beside what they were before; the first change."""

    looks: int
    changed: ChangedArgument | None


class HandedOptions(HandedActions):
    """Options of a reset, beside what they were before."""


@dataclass(frozen=True, slots=True)
class WrittenValues:
    """Another course of an episode, in words, once values of one kind (the field) were changed."""

    seen: str | None


@dataclass(frozen=True, slots=True)
class OfferedCalls:
    """Kinds of calls that the environment answers."""

    kinds: list[str]


@dataclass(frozen=True, slots=True)
class RepeatedLast:
    """`last()` called twice at each turn: reward and flags by both where they first differed."""

    looks: int
    told: tuple[Any, Any] | None
