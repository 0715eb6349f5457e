"""The buffer: rows that a capture appends while an episode runs, before they become columns.

Flat lists, a fixed stride each, so that nothing the cyclic garbage collector has to track survives
a step (a tuple for each turn cost 6.9 us where a flat list costs 2.7). One thread appends, one
takes from the front; each operation on a list is atomic, and the entry in `turns` is the mark of a
whole turn, appended after all else that belongs to it. Rows that no mark covers are an interrupted
turn's, and are cut back before the next one.
"""

from __future__ import annotations

from bisect import bisect_left
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any, Final, TypeVar

T = TypeVar("T")

# given: place of the agent in the layout, observation, mask, cumulative reward, terminated,
# truncated, info, live, nonconforming
GIVEN: Final = 9
# done: order, action, reward, terms, raised, nonconforming
DONE: Final = 6
# turns: episode, turn, rows (below 0: so many usual rows), wall_ns (None for closing rows, which no
# step follows), observed_ns, acted_ns, state, nonconforming
TURN: Final = 8


class LargePlace(int):
    """Place of a large observation that was put aside; the buffer holds it instead of the bytes."""


@dataclass(frozen=True, slots=True)
class EpisodeStart:
    """Start of an episode, with the arguments of its reset.

    `since` is the episode of the last seeded reset, itself where this one was seeded, -1 where none
    ever was: an unseeded episode without an `opening` (states of generators, attributes that were
    set) replays only by running on from there.
    """

    episode: int
    seed: int | None
    since: int
    options: str | None
    policies: str | None
    task: str | None = None
    opening: str | None = None


@dataclass(frozen=True, slots=True)
class EpisodeEnd:
    """End of an episode: its kind (`ended`, `cut` or `failed`), its number of steps, the reason."""

    episode: int
    end: str
    turns: int
    error: str | None = None
    endings: str | None = None
    action_types: str | None = None
    opening: str | None = None


class Observed:
    """Stands in place of an observation that was looked at and isn't kept."""


OBSERVED: Final = Observed()


@dataclass(slots=True)
class UsualRows:
    """Rows of level `actions` in which no flag is set: place in the layout, action, reward."""

    agents: list[int] = field(default_factory=list)
    actions: list[Any] = field(default_factory=list)
    rewards: list[Any] = field(default_factory=list)

    def cut(self, count: int) -> UsualRows:
        """The first `count` rows, taken off."""
        parts = _cut(self.agents, count), _cut(self.actions, count), _cut(self.rewards, count)
        return UsualRows(*parts)

    def trim(self, count: int) -> None:
        """Takes off the rows after the first `count`."""
        del self.agents[count:], self.actions[count:], self.rewards[count:]


@dataclass(slots=True)
class Buffer:
    """Rows not encoded yet; `given` and `done` are aligned row by row once a turn is committed.

    A turn of level `actions` whose rows are all usual has them in `usual`, and nothing elsewhere.
    """

    given: list[object] = field(default_factory=list)
    done: list[object] = field(default_factory=list)
    turns: list[object] = field(default_factory=list)
    starts: list[EpisodeStart] = field(default_factory=list)
    ends: list[EpisodeEnd] = field(default_factory=list)
    usual: UsualRows = field(default_factory=UsualRows)
    # held while the buffer is cut; a real one where two threads cut it
    lock: AbstractContextManager[object] = field(
        default_factory=nullcontext, repr=False, compare=False
    )


@dataclass(frozen=True, slots=True)
class BufferedTurns:
    """Whole turns taken off a buffer, as lists with the strides above."""

    given: list[object]
    done: list[object]
    turns: list[object]
    starts: list[EpisodeStart]
    ends: list[EpisodeEnd]
    usual: UsualRows = field(default_factory=UsualRows)


def take(buffer: Buffer, *, most: int, most_rows: int = 65_536) -> BufferedTurns | None:
    """The oldest whole turns of `buffer`, taken off it; None if there are none.

    At most `most` turns, and no further turn once `most_rows` rows are taken.

    Ends are counted before turns and starts after, so that a start never comes after a turn of its
    episode and an end never before one.
    """
    with buffer.lock:
        ends = len(buffer.ends)
        waiting = len(buffer.turns) // TURN
        counts: list[int] = buffer.turns[2 : min(waiting, most) * TURN : TURN]  # type: ignore[assignment]  # numbers of rows
        if sum(map(abs, counts)) >= most_rows:
            # the turn that reaches `most_rows` is the last one taken
            reached = list(accumulate(map(abs, counts)))
            del counts[bisect_left(reached, most_rows) + 1 :]
        turns = len(counts)
        starts = len(buffer.starts)
        if not (starts or ends or turns):
            return None
        if turns < waiting:  # an end waits until the turns of its episode are taken
            following = buffer.turns[turns * TURN]
            ends = sum(end.episode < following for end in buffer.ends[:ends])  # type: ignore[operator]
        rows, usual = _rows_of(counts)
        return BufferedTurns(
            _cut(buffer.given, rows * GIVEN),
            _cut(buffer.done, rows * DONE),
            _cut(buffer.turns, turns * TURN),
            _cut(buffer.starts, starts),
            _cut(buffer.ends, ends),
            buffer.usual.cut(usual),
        )


@dataclass(frozen=True, slots=True)
class Counts:
    """Numbers of turns, rows, usual rows, starts and ends at the front of a buffer."""

    turns: int = 0
    rows: int = 0
    usual: int = 0
    starts: int = 0
    ends: int = 0


def added(buffer: Buffer, since: Counts) -> tuple[BufferedTurns, Counts]:
    """Copies the whole turns behind those that `since` counts, and counts them too."""
    with buffer.lock:  # counted in the order that `take` explains
        ends = len(buffer.ends)
        turns = len(buffer.turns) // TURN
        marks = buffer.turns[since.turns * TURN : turns * TURN]
        rows, usual = _rows_of(marks[2::TURN])  # type: ignore[arg-type]  # numbers of rows
        now = Counts(turns, since.rows + rows, since.usual + usual, len(buffer.starts), ends)
        few = slice(since.usual, now.usual)
        waiting = buffer.usual
        return BufferedTurns(
            buffer.given[since.rows * GIVEN : now.rows * GIVEN],
            buffer.done[since.rows * DONE : now.rows * DONE],
            marks,
            buffer.starts[since.starts : now.starts],
            buffer.ends[since.ends : ends],
            UsualRows(waiting.agents[few], waiting.actions[few], waiting.rewards[few]),
        ), now


def cut_back(buffer: Buffer) -> None:
    """Takes off rows without a commit mark: an interrupt came while their turn was appended."""
    with buffer.lock:
        counts: list[int] = buffer.turns[2::TURN]  # type: ignore[assignment]  # as in take
        rows, usual = _rows_of(counts)
        del buffer.given[rows * GIVEN :], buffer.done[rows * DONE :]
        buffer.usual.trim(usual)


def _rows_of(counts: list[int]) -> tuple[int, int]:
    """Numbers of rows and of usual rows, by what turns say: the second count below 0."""
    every, difference = sum(map(abs, counts)), sum(counts)
    return (every + difference) // 2, (every - difference) // 2


def _cut(items: list[T], count: int) -> list[T]:
    front = items[:count]
    del items[:count]
    return front
