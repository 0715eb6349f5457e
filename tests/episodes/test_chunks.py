"""An episode from its front: no row twice, no turn split, and compared as if it were whole."""

from typing import Any

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.episodes import chunks as module
from gamekeeper.episodes.chunks import RowReader
from gamekeeper.episodes.divergence import compare, compare_chunks
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.tables import MemoryTables
from gamekeeper.runs.recording import rollout
from tests.runs.walks import Turns, Walk

turns = st.lists(st.integers(0, 12), max_size=30).map(sorted)


def rows_of(numbers: list[int]) -> pa.Table:
    """A table with these turns."""
    return pa.table({"turn": pa.array(numbers, pa.int32())})


def parts_of(numbers: list[int], size: int) -> list[pa.Table]:
    """The table in parts of that size; at least one."""
    starts = range(0, max(len(numbers), 1), size)
    return [rows_of(numbers[start : start + size]) for start in starts]


@given(turns, st.integers(1, 9), st.integers(1, 9))
def test_front_hands_out_whole_turns_once(numbers: list[int], size: int, rows: int) -> None:
    """However rows were cut into parts: each comes once, in order, a turn never in two takes."""
    front, taken = RowReader(parts_of(numbers, size)), []
    while (before := front.bound(rows)) is not None:
        table = front.take(before)
        assert table is not None
        taken.append(table["turn"].to_pylist())
        assert taken[-1], "no step forward"
        assert max(taken[-1]) < before
    rest = front.take(None)
    assert rest is not None
    taken.append(rest["turn"].to_pylist())

    assert numbers == [turn for each in taken for turn in each]
    assert sum(len(set(each)) for each in taken) == len(set(numbers))


@given(turns, st.integers(1, 9), st.integers(0, 13))
def test_front_takes_what_comes_before(numbers: list[int], size: int, before: int) -> None:
    """Rows of earlier turns are taken, all others stay; parts may be put there one by one."""
    front = RowReader()
    for part in parts_of(numbers, size):
        front.add(part)
    first, rest = front.take(before), front.take(None)

    assert first is not None
    assert rest is not None
    assert [n for n in numbers if n < before] == first["turn"].to_pylist()
    assert [n for n in numbers if n >= before] == rest["turn"].to_pylist()


def test_front_without_anything_has_no_table() -> None:
    """Nothing ever came, so nobody knows its columns."""
    assert RowReader().take(None) is None
    assert RowReader().bound(3) is None
    assert RowReader().schema is None


def test_strip_of_large_values_has_short_stretches(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stretch is bounded by its bytes too."""
    evidence = played(Walk())
    monkeypatch.setattr("gamekeeper.episodes.block.BLOCK_BYTES", 1)
    header = next(evidence.headers)
    stretches = list(evidence.chunks(header).stretches())

    assert len(stretches) > len(evidence.episode_of(header))
    assert all(len(set(episode.steps["turn"].to_pylist())) <= 1 for episode, _ in stretches)


def played(env: Any, **options: Any) -> Evidence:
    """One episode of an environment, in memory."""
    return rollout(env, episodes=1, seed=0, **options)


def torn(evidence: Evidence, *, turns: int | None) -> Evidence:
    """The same, as if its recorder had been killed in its last turn."""
    assert isinstance(evidence.tables, MemoryTables)
    tables = dict(evidence.tables.tables)
    steps, episodes = tables["agent_steps"], tables["episodes"].to_pylist()
    tables["agent_steps"] = steps.slice(0, steps.num_rows - 3)
    row = {**episodes[0], "end": "torn", "turns": turns, "endings": None}
    tables["episodes"] = pa.Table.from_pylist([row], schema=tables["episodes"].schema)
    return Evidence(evidence.manifest, MemoryTables(tables), path=evidence.path)


PLAYS = {
    "whole": lambda: played(Walk()),
    "again": lambda: played(Walk()),
    "shorter": lambda: played(Walk(), most_turns=2),
    "other": lambda: played(Walk(turns=2)),
    "shifted": lambda: played(Walk(), policies="first-legal"),
    "in turn": lambda: played(Turns()),
    "in turn, shorter": lambda: played(Turns(), most_turns=3),
    "torn": lambda: torn(played(Walk()), turns=None),
    "torn, told": lambda: torn(played(Walk()), turns=1),
}


@pytest.fixture(scope="module")
def plays() -> list[Evidence]:
    """Plays that are alike, shorter, longer, torn, or another game's."""
    return [make() for make in PLAYS.values()]


@pytest.mark.parametrize("rows", [1, 3, 1_000])
def test_chunks_compare_as_whole_episodes_do(
    plays: list[Evidence], rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first divergence, exactness and size are those of the whole, whatever the stretches."""
    monkeypatch.setattr(module, "ROWS", rows)
    for one in plays:
        for two in plays:
            left, right = next(one.headers), next(two.headers)
            for tolerance in (None, 10.0):
                whole = compare(one.episode_of(left), two.episode_of(right), tolerance=tolerance)
                apart = compare_chunks(
                    one.chunks(left), two.chunks(right), known=one.extent(left), tolerance=tolerance
                )
                assert str(whole.divergence) == str(apart.divergence)
                assert whole.is_exact == apart.is_exact
                if whole.divergence is None:
                    assert whole.largest == apart.largest
