"""Facts of the probe `lifecycle`."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class StepAfterEnd:
    """Result of a step after the end of an episode, in words; empty where nothing came of it."""

    gave: str


@dataclass(frozen=True, slots=True)
class LaterReset:
    """A reset, mostly after others, then a few turns; its time and exception in words."""

    when: str
    raised: str | None
    agents: int | None


@dataclass(frozen=True, slots=True)
class IgnoredResets:
    """Resets in mid-episode; ignored where all of them gave what stood there before."""

    is_ignored: bool


@dataclass(frozen=True, slots=True)
class DeadAction:
    """An action of a dead agent that isn't None, and the class of the exception that it raised."""

    agent: Any
    raised: str | None


@dataclass(frozen=True, slots=True)
class IteratedAgents:
    """`agent_iter` over the first turns.

    Attributes:
        named: by `agent_iter`.
        selected: by `agent_selection` at that time.
        asked: turns that were asked for.
    """

    named: list[str]
    selected: list[str]
    asked: int


@dataclass(frozen=True, slots=True)
class ResetArguments:
    """Exceptions that resets raised, by their arguments in words."""

    raised: dict[str, str | None]


class StepBeforeReset(StepAfterEnd):
    """A step before any reset."""


@dataclass(frozen=True, slots=True)
class Closings:
    """Exceptions that `close` raised, by the time of the call."""

    raised: dict[str, str | None]
