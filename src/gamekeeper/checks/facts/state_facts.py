"""Facts of the probe `state`."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class StateAnswer:
    """One answer of `state()`.

    Attributes:
        turn: at which it was asked for.
        is_within: whether it lies within the space; None without one.
        has_nan: whether a NaN is in it.
        again: digest of a second answer.
    """

    turn: int
    failed: str | None
    kind: str
    dtype: str | None
    shape: list[int] | None
    is_within: bool | None
    has_nan: bool
    over: bool = False
    digest: str = ""
    again: str = ""


@dataclass(frozen=True, slots=True)
class StateSpace:
    """The declared space of `state()`, with its shape and dtype where it has any."""

    is_there: bool
    space: str | None
    shape: Any
    dtype: str | None


@dataclass(frozen=True, slots=True)
class StateAnswers:
    """Answers of `state()`, and the number of turns at which an agent's observation changed."""

    moves: int
    answers: list[StateAnswer]


@dataclass(frozen=True, slots=True)
class UsedState:
    """Turn of the first state that differs in the second of an instance's two equal episodes.

    Only where a state asked twice is the same.
    """

    turn: int | None


@dataclass(frozen=True, slots=True)
class LateState:
    """Trials with other actions at one turn, in which observations changed at once.

    Attributes:
        at_once: of them, states that changed at once.
        later: of them, states that changed a turn later.
        turn: of the last of them.
        other: its other actions.
    """

    trials: int
    at_once: int
    later: int
    turn: int | None
    other: dict[Any, Any] | None
