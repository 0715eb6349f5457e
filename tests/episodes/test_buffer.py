"""The buffer hands over whole turns, in order, whoever appends meanwhile."""

import sys
import threading

from hypothesis import example, given
from hypothesis import strategies as st

from gamekeeper.episodes.buffer import (
    DONE,
    GIVEN,
    TURN,
    Buffer,
    BufferedTurns,
    EpisodeEnd,
    EpisodeStart,
    cut_back,
    take,
)

EPISODES = st.lists(st.lists(st.integers(0, 4), max_size=6), min_size=1, max_size=5)


def append(buffer: Buffer, episode: int, turn: int, rows: int) -> None:
    """One whole turn whose rows say where they belong."""
    for row in range(rows):
        buffer.given.extend((row, (episode, turn), *[None] * (GIVEN - 2)))
        buffer.done.extend((row, (episode, turn), *[None] * (DONE - 2)))
    buffer.turns.extend((episode, turn, rows, 1, *[None] * 4))


def write(buffer: Buffer, episodes: list[list[int]]) -> None:
    """Episodes whose turns have these numbers of rows."""
    for episode, turns in enumerate(episodes):
        buffer.starts.append(EpisodeStart(episode, 1, episode, None, None))
        for turn, rows in enumerate(turns):
            append(buffer, episode, turn, rows)
        buffer.ends.append(EpisodeEnd(episode, "ended", len(turns)))


def check(buffered_parts: list[BufferedTurns], episodes: list[list[int]]) -> None:
    """Every turn once, whole and in order; starts before and ends after the turns of theirs."""
    begun: list[int] = []
    over: list[int] = []
    seen: list[tuple[int, int, int]] = []
    for buffered in buffered_parts:
        begun += [start.episode for start in buffered.starts]
        marks = list(zip(*(buffered.turns[place::TURN] for place in range(3)), strict=True))
        assert all(mark[0] in begun and mark[0] not in over for mark in marks)
        seen += marks  # type: ignore[arg-type]
        where = [(episode, turn) for episode, turn, rows in marks for _ in range(rows)]  # type: ignore[call-overload]
        assert where == buffered.given[1::GIVEN] == buffered.done[1::DONE]
        over += [end.episode for end in buffered.ends]
    assert begun == over == list(range(len(episodes)))
    assert seen == [
        (episode, turn, rows)
        for episode, turns in enumerate(episodes)
        for turn, rows in enumerate(turns)
    ]


def drain(buffer: Buffer, most: int, most_rows: int) -> list[BufferedTurns]:
    """All buffered turns there are, none longer than asked for."""
    buffered_parts = []
    while (buffered := take(buffer, most=most, most_rows=most_rows)) is not None:
        assert len(buffered.turns) <= most * TURN
        assert sum(buffered.turns[2:-TURN:TURN]) < most_rows or len(buffered.turns) <= TURN  # type: ignore[arg-type]
        buffered_parts.append(buffered)
    return buffered_parts


@given(EPISODES, st.integers(1, 5), st.integers(1, 9))
@example([[1, 0]], 2, 1)  # a turn without rows after the one that reaches the bound
def test_buffered_parts_hold_whole_turns_in_order(
    episodes: list[list[int]], most: int, most_rows: int
) -> None:
    """However many turns or rows one takes."""
    buffer = Buffer()
    write(buffer, episodes)
    check(drain(buffer, most, most_rows), episodes)
    assert buffer == Buffer()


def test_take_gives_none_only_where_there_is_nothing() -> None:
    """A start alone and an end alone are taken too."""
    buffer = Buffer()
    assert take(buffer, most=9) is None
    buffer.starts.append(EpisodeStart(0, 1, 0, None, None))
    buffered = take(buffer, most=9)
    assert buffered is not None
    assert [start.episode for start in buffered.starts] == [0]
    buffer.ends.append(EpisodeEnd(0, "cut", 0))
    buffered = take(buffer, most=9)
    assert buffered is not None
    assert [end.episode for end in buffered.ends] == [0]
    assert take(buffer, most=9) is None


def test_rows_without_a_mark_stay_and_can_be_cut_back() -> None:
    """A turn in the making is nobody's yet; an interrupted one is dropped."""
    buffer = Buffer()
    append(buffer, 0, 0, 2)
    buffer.given.extend([7] * (2 * GIVEN))
    buffer.done.extend([7] * DONE)
    assert take(buffer, most=9) is not None
    assert (len(buffer.given), len(buffer.done)) == (2 * GIVEN, DONE)
    append_after = Buffer(given=buffer.given, done=buffer.done)
    cut_back(append_after)
    assert append_after == Buffer()


def test_take_beside_a_thread_that_appends_mixes_nothing_up() -> None:
    """One appends as fast as it can, one takes; the interpreter switches every few microseconds."""
    episodes = [[turn % 4 for turn in range(40)] for _ in range(60)]
    buffer = Buffer()
    writer = threading.Thread(target=write, args=(buffer, episodes))
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    buffered_parts = []
    try:
        writer.start()
        while writer.is_alive():
            buffered_parts += drain(buffer, 7, 12)
    finally:
        sys.setswitchinterval(interval)
        writer.join()
    buffered_parts += drain(buffer, 7, 12)
    check(buffered_parts, episodes)
