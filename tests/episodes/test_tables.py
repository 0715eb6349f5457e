"""An episode's rows out of a whole table, however it is cut into chunks."""

from itertools import pairwise

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.episodes import evidence as module
from gamekeeper.episodes.encoder import EPISODES
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.tables import MemoryTables, episode_rows
from gamekeeper.errors import EvidenceError

LARGEST = 2**31 - 2


def table_of(numbers: list[int], cuts: list[int]) -> pa.Table:
    """A table with these episode numbers, in chunks that end at `cuts`; some may be empty."""
    bounds = [0, *sorted(min(cut, len(numbers)) for cut in cuts), len(numbers)]
    chunks = [pa.array(numbers[first:last], pa.int32()) for first, last in pairwise(bounds)]
    places = pa.chunked_array([pa.array(range(len(numbers)), pa.int64())])
    return pa.table({"episode": pa.chunked_array(chunks, pa.int32()), "place": places})


def evidence_of(numbers: list[int]) -> Evidence:
    """Evidence of episodes with these numbers, and of nothing else."""
    rows = [{"episode": number, "seed": 100 + number} for number in numbers]
    tables = MemoryTables({"episodes": pa.Table.from_pylist(rows, schema=EPISODES)})
    return Evidence({"environment": {}}, tables)


@given(
    st.lists(st.integers(0, 6) | st.just(LARGEST)).map(sorted),
    st.lists(st.integers(0, 20), max_size=5),
    st.integers(0, 7) | st.just(LARGEST),
)
def test_episode_rows_are_those_of_the_episode(
    numbers: list[int], cuts: list[int], episode: int
) -> None:
    """Neither one more nor one less, wherever chunks begin and end."""
    expected = [place for place, number in enumerate(numbers) if number == episode]
    assert expected == episode_rows(table_of(numbers, cuts), episode)["place"].to_pylist()


@pytest.mark.parametrize("episode", [3, 5, LARGEST])
def test_trace_finds_its_header_among_gaps(episode: int) -> None:
    """Numbers needn't follow each other: episodes of several workers may have gaps."""
    assert evidence_of([0, 3, 5, LARGEST]).episode(episode).seed == 100 + episode


@pytest.mark.parametrize("episode", [-1, 1, 4, 2**31 - 1, 2**40])
def test_trace_of_no_episode_is_refused(episode: int) -> None:
    """Also of numbers that no run can hold."""
    with pytest.raises(EvidenceError, match="has no episode"):
        evidence_of([0, 3, 5]).episode(episode)


def test_traces_make_headers_as_they_go(monkeypatch: pytest.MonkeyPatch) -> None:
    """In batches, in their order, none left out."""
    monkeypatch.setattr(module, "HEADERS", 3)
    assert list(range(8)) == [episode.episode for episode in evidence_of(list(range(8))).episodes]
