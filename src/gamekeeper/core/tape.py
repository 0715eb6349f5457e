"""The tape: what the door writes while a game is played, before it becomes columns.

Flat lists, a fixed stride each, so that nothing the cyclic garbage collector has to track survives
a step (a tuple for each turn cost 6.9 us where a flat list costs 2.7). One thread appends, one
takes from the front; each operation on a list is atomic, and the entry in `turns` is the mark of a
whole turn, appended after all else that belongs to it. Rows that no mark covers are an interrupted
turn's, and are cut back before the next one.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Final, TypeVar

T = TypeVar("T")

# given: seat, observation, mask, received, terminated, truncated, info, live, odd
GIVEN: Final = 9
# done: order, action, reward, terms, raised, odd
DONE: Final = 6
# turns: episode, turn, rows, wall_ns (None for closing rows, which no crossing follows), state, odd
TURN: Final = 6


class Place(int):
    """Where a large observation was put aside; stands on the tape in place of its bytes."""


@dataclass(frozen=True, slots=True)
class EpisodeStart:
    """An episode begins: what its reset was told.

    `since` is the episode of the last seeded reset, itself where this one was seeded, -1 where none
    ever was: an unseeded episode replays only by running on from there.
    """

    episode: int
    seed: int | None
    since: int
    options: str | None
    policies: str | None
    task: str | None = None


@dataclass(frozen=True, slots=True)
class EpisodeEnd:
    """An episode is over: how (`ended`, `cut` or `failed`), after how many crossings, and why."""

    episode: int
    end: str
    turns: int
    error: str | None = None
    endings: str | None = None
    action_types: str | None = None


@dataclass(slots=True)
class Tape:
    """Rows in the making; `given` and `done` are aligned row by row once a turn is committed."""

    given: list[object] = field(default_factory=list)
    done: list[object] = field(default_factory=list)
    turns: list[object] = field(default_factory=list)
    starts: list[EpisodeStart] = field(default_factory=list)
    ends: list[EpisodeEnd] = field(default_factory=list)
    # held while the tape is cut; a real one where two threads cut it
    lock: AbstractContextManager[object] = field(
        default_factory=nullcontext, repr=False, compare=False
    )


@dataclass(frozen=True, slots=True)
class Reel:
    """A stretch of whole turns taken off a tape, as lists with the strides above."""

    given: list[object]
    done: list[object]
    turns: list[object]
    starts: list[EpisodeStart]
    ends: list[EpisodeEnd]


def take(tape: Tape, *, most: int, most_rows: int = 65_536) -> Reel | None:
    """The oldest whole turns of `tape`, taken off it; None if there are none.

    At most `most` turns, and no further turn once `most_rows` rows are taken.

    Ends are counted before turns and starts after, so that a start never comes after a turn of its
    episode and an end never before one.
    """
    with tape.lock:
        return _take(tape, most, most_rows)


def cut_back(tape: Tape) -> None:
    """Takes off rows without a commit mark: an interrupt came while their turn was appended."""
    with tape.lock:
        rows: int = sum(tape.turns[2::TURN])  # type: ignore[arg-type]  # as in _take
        del tape.given[rows * GIVEN :], tape.done[rows * DONE :]


def _take(tape: Tape, most: int, most_rows: int) -> Reel | None:
    ends = len(tape.ends)
    waiting = len(tape.turns) // TURN
    turns = _within(tape.turns[2 : min(waiting, most) * TURN : TURN], most_rows)
    starts = len(tape.starts)
    if not (starts or ends or turns):
        return None
    if turns < waiting:
        following = tape.turns[turns * TURN]
        ends = sum(end.episode < following for end in tape.ends[:ends])  # type: ignore[operator]
    marks = _cut(tape.turns, turns * TURN)
    rows: int = sum(marks[2::TURN])  # type: ignore[arg-type]  # the rows field is always an int
    return Reel(
        _cut(tape.given, rows * GIVEN),
        _cut(tape.done, rows * DONE),
        marks,
        _cut(tape.starts, starts),
        _cut(tape.ends, ends),
    )


def _within(counts: list[object], most_rows: int) -> int:
    taken = rows = 0
    for count in counts:
        if rows >= most_rows:
            break
        taken += 1
        rows += count  # type: ignore[operator]  # the rows field is always an int
    return taken


def _cut(items: list[T], count: int) -> list[T]:
    front = items[:count]
    del items[:count]
    return front
