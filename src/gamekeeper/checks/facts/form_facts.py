"""Facts of the probe `form`: whole episodes in short, and replaced moves with all they changed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

Influenced: TypeAlias = Literal["mask", "observation", "reward", "ending"]


@dataclass(frozen=True, slots=True)
class AgentEnding:
    """One agent's end, seen after a move.

    Attributes:
        round: of the move.
        step: number of the env step, so that agents that ended together are known.
        kind: `termination` or `truncation`.
    """

    agent: str
    round: int
    step: int
    kind: str


@dataclass(frozen=True, slots=True)
class EpisodeShape:
    """One episode under random legal moves, without its values.

    Attributes:
        rounds: agents that acted in each round, in their order; of a Parallel tick by roster.
        first: agents at the start.
        joined: agents that appeared after the reset, with the round.
        left: agents that left the roster without an ending, with the round.
        live: agents not ended before each env step at which one ended, by step.
        fares: by agent, sums of features: reward, magnitude of rewards, actions, terminated.
        is_over: the episode ended by itself.
    """

    rounds: tuple[tuple[str, ...], ...]
    first: tuple[str, ...]
    endings: tuple[AgentEnding, ...]
    joined: tuple[tuple[str, int], ...]
    left: tuple[tuple[str, int], ...]
    live: Mapping[int, int]
    fares: Mapping[str, tuple[float, ...]]
    is_over: bool


@dataclass(frozen=True, slots=True)
class MoveLook:
    """One value that a replaced move may have changed.

    Attributes:
        target: agent whose value it is.
        on: which value.
        lag: rounds from the move: to the payment or ending, or to the decision that is made with
            the observation or mask; 0 is the same round.
        is_changed: it differs from the unchanged rerun's.
        is_early: paid or seen before all agents of the move's round had moved.
        turn: env step of the payment or decision.
    """

    target: str
    on: Influenced
    lag: int
    is_changed: bool
    is_early: bool
    turn: int


@dataclass(frozen=True, slots=True)
class MoveTrial:
    """One move replaced by another legal one, and what came of it.

    Attributes:
        round: its number in the episode.
        turn: env step of the move.
        choice: the other move.
        movers: agents of the round, in their order.
        looks: at all that could be compared.
        ahead: rounds that were looked ahead.
        is_order_moved: afterwards agents acted in another order, though none ended or joined.
        is_shifted: (AEC) the replaced move drew more or fewer random numbers, so that what follows
            may differ by what is drawn alone.
    """

    agent: str
    round: int
    turn: int
    choice: Any
    movers: tuple[str, ...]
    looks: tuple[MoveLook, ...]
    ahead: int
    is_order_moved: bool
    is_shifted: bool = False


@dataclass(frozen=True, slots=True)
class DrawnPriority:
    """Replaced moves of two agents in several random futures: which of them takes from the other.

    A move takes where its agent gains what the other loses, or the reverse.

    Attributes:
        agents: two agents of which one's move changed the other's reward, and not the reverse.
        turn: of the tick.
        ways: for each future, the first takes from the second, and the second from the first.
    """

    agents: tuple[str, str]
    turn: int
    ways: tuple[tuple[bool, bool], ...]


@dataclass(frozen=True, slots=True)
class FormError:
    """An exception during `an episode` of the form, or its `replaced moves`, which it ended."""

    during: str
    error: str


@dataclass(frozen=True, slots=True)
class UnsettledMoves:
    """Env step from which an unchanged rerun differs: nothing can be said of moves after it."""

    turn: int
