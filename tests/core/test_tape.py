"""The tape hands over whole turns, in order, whoever appends meanwhile."""

from __future__ import annotations

import sys
import threading

from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.core.tape import (
    DONE,
    GIVEN,
    TURN,
    EpisodeEnd,
    EpisodeStart,
    Reel,
    Tape,
    cut_back,
    take,
)

EPISODES = st.lists(st.lists(st.integers(0, 4), max_size=6), min_size=1, max_size=5)


def append(tape: Tape, episode: int, turn: int, rows: int) -> None:
    """One whole turn whose rows say where they belong."""
    for row in range(rows):
        tape.given.extend((row, (episode, turn), *[None] * (GIVEN - 2)))
        tape.done.extend((row, (episode, turn), *[None] * (DONE - 2)))
    tape.turns.extend((episode, turn, rows, 1, None, None))


def write(tape: Tape, episodes: list[list[int]]) -> None:
    """Episodes whose turns have these numbers of rows."""
    for episode, turns in enumerate(episodes):
        tape.starts.append(EpisodeStart(episode, 1, episode, None, None))
        for turn, rows in enumerate(turns):
            append(tape, episode, turn, rows)
        tape.ends.append(EpisodeEnd(episode, "ended", len(turns)))


def check(reels: list[Reel], episodes: list[list[int]]) -> None:
    """Every turn once, whole and in order; starts before and ends after the turns of theirs."""
    begun: list[int] = []
    over: list[int] = []
    seen: list[tuple[int, int, int]] = []
    for reel in reels:
        begun += [start.episode for start in reel.starts]
        marks = list(zip(*(reel.turns[place::TURN] for place in range(3)), strict=True))
        assert all(mark[0] in begun and mark[0] not in over for mark in marks)
        seen += marks  # type: ignore[arg-type]
        where = [(episode, turn) for episode, turn, rows in marks for _ in range(rows)]  # type: ignore[call-overload]
        assert where == reel.given[1::GIVEN] == reel.done[1::DONE]
        over += [end.episode for end in reel.ends]
    assert begun == over == list(range(len(episodes)))
    assert seen == [
        (episode, turn, rows)
        for episode, turns in enumerate(episodes)
        for turn, rows in enumerate(turns)
    ]


def drain(tape: Tape, most: int, most_rows: int) -> list[Reel]:
    """All reels there are, none longer than asked for."""
    reels = []
    while (reel := take(tape, most=most, most_rows=most_rows)) is not None:
        assert len(reel.turns) <= most * TURN
        assert sum(reel.turns[2:-TURN:TURN]) < most_rows or len(reel.turns) <= TURN  # type: ignore[arg-type]
        reels.append(reel)
    return reels


@given(EPISODES, st.integers(1, 5), st.integers(1, 9))
def test_reels_hold_whole_turns_in_order(
    episodes: list[list[int]], most: int, most_rows: int
) -> None:
    """However many turns or rows one takes."""
    tape = Tape()
    write(tape, episodes)
    check(drain(tape, most, most_rows), episodes)
    assert tape == Tape()


def test_take_gives_none_only_where_there_is_nothing() -> None:
    """A start alone and an end alone are taken too."""
    tape = Tape()
    assert take(tape, most=9) is None
    tape.starts.append(EpisodeStart(0, 1, 0, None, None))
    reel = take(tape, most=9)
    assert reel is not None
    assert [start.episode for start in reel.starts] == [0]
    tape.ends.append(EpisodeEnd(0, "cut", 0))
    reel = take(tape, most=9)
    assert reel is not None
    assert [end.episode for end in reel.ends] == [0]
    assert take(tape, most=9) is None


def test_rows_without_a_mark_stay_and_can_be_cut_back() -> None:
    """A turn in the making is nobody's yet; an interrupted one is dropped."""
    tape = Tape()
    append(tape, 0, 0, 2)
    tape.given.extend([7] * (2 * GIVEN))
    tape.done.extend([7] * DONE)
    assert take(tape, most=9) is not None
    assert (len(tape.given), len(tape.done)) == (2 * GIVEN, DONE)
    append_after = Tape(given=tape.given, done=tape.done)
    cut_back(append_after)
    assert append_after == Tape()


def test_take_beside_a_thread_that_appends_mixes_nothing_up() -> None:
    """One appends as fast as it can, one takes; the interpreter switches every few microseconds."""
    episodes = [[turn % 4 for turn in range(40)] for _ in range(60)]
    tape = Tape()
    writer = threading.Thread(target=write, args=(tape, episodes))
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    reels = []
    try:
        writer.start()
        while writer.is_alive():
            reels += drain(tape, 7, 12)
    finally:
        sys.setswitchinterval(interval)
        writer.join()
    reels += drain(tape, 7, 12)
    check(reels, episodes)
