"""Facts of the probes `surface` and `metadata`: the outside of an environment."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class PossibleAgents:
    """`possible_agents` along an episode; None where it isn't there.

    Attributes:
        fresh: whether the instance was a fresh one.
        before: named before the reset.
        turns: named at the start of each turn.
        again: named after the episode and one more reset.
    """

    fresh: bool
    before: list[str] | None
    turns: list[list[str] | None]
    again: list[str] | None


@dataclass(frozen=True, slots=True)
class LiveRosters:
    """`agents` along an episode; None where a reset raised.

    Attributes:
        first: after a reset.
        turns: after a reset with the same seed, and at the start of each turn.
        again: after the episode and a third reset.
        midway: where an agent left before the others: turns played until then, and the roster after
            a reset at once.
    """

    first: list[str] | None
    turns: list[list[str] | None]
    again: list[str] | None
    midway: tuple[int, list[str] | None] | None


@dataclass(frozen=True, slots=True)
class RosterKinds:
    """Turn and types of `agents` and `possible_agents`, after a reset and wherever they change."""

    kinds: list[tuple[int, list[str]]]


@dataclass(frozen=True, slots=True)
class AgentCounts:
    """Counts by turn: num_agents, max_num_agents, and the sizes of `agents` and `possible_agents`.

    max_num_agents is None where the environment gives none.
    """

    turns: list[list[Any]]


@dataclass(frozen=True, slots=True)
class ReturnedForms:
    """Forms of what was returned.

    Attributes:
        calls: by call of reset and step (Parallel), or of `last` after the third reset (AEC): what
            is wrong, in words; empty if nothing is.
        infos_answer: whether infos answer for any agent, as a defaultdict does.
    """

    calls: list[str]
    infos_answer: bool = False


@dataclass(frozen=True, slots=True)
class TurnBooks:
    """Agents and the books of an AEC environment at one turn.

    Attributes:
        missing: by book, live agents without an entry.
        strangers: by book, agents with an entry that aren't in `agents`.
    """

    missing: dict[str, list[str]]
    strangers: dict[str, list[str]]


@dataclass(frozen=True, slots=True)
class BookEntries:
    """Agents of which an AEC environment's books speak, by turn."""

    turns: list[TurnBooks]


@dataclass(frozen=True, slots=True)
class TimeLimits:
    """Whole numbers that an environment holds from the reset to the end of an episode.

    By name, where it sounds like a limit of time.
    """

    limits: dict[str, int]


@dataclass(frozen=True, slots=True)
class FlaggedAgents:
    """Agents of an AEC environment whose flags are up right after its first three resets."""

    resets: list[list[str]]


@dataclass(frozen=True, slots=True)
class Metadata:
    """Contents of `metadata`.

    Attributes:
        own: the render mode in use.
        renders: its constructor takes a render mode, and its `render` does something.
    """

    kind: str
    fields: dict[str, Any]
    own: str | None
    renders: bool


@dataclass(frozen=True, slots=True)
class LaterMetadata:
    """Metadata before and after the environment was used, as canonical text.

    Attributes:
        after: what was done, in which mode, and the text then.
    """

    before: str
    after: list[tuple[str, str | None, str]]
