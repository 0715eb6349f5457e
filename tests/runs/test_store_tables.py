"""Finalized tables, read by those who know nothing of gamekeeper."""

from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.runs.files import parquet_tables as table_writer
from gamekeeper.runs.files.parquet_tables import TableReader, write_table
from gamekeeper.runs.files.segments import SegmentReader, SegmentWriter
from tests.runs import run_folders
from tests.runs.run_folders import read


@pytest.fixture(scope="module")
def run_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finalized run of three episodes."""
    return run_folders.finalized_run(tmp_path_factory.mktemp("b") / "b", episodes=3, turns=8)


def test_duckdb_adds_up_rewards_by_agent(run_files: Path) -> None:
    """The query of the run's page works, also over lists of floats."""
    steps = run_files / "agent_steps.parquet"
    query = f"SELECT agent, sum(reward) FROM '{steps}' GROUP BY agent ORDER BY agent"
    assert duckdb.sql(query).fetchall() == [("carrier_0", 12.0), ("picker_0", 12.0)]
    sums = duckdb.sql(
        f"SELECT sum(list_sum(obs)), max(turn) FROM '{run_files}/agent_steps.parquet'"
    )
    values = np.stack(read(run_files).agent_steps["obs"].to_numpy())
    total, turn = sums.fetchall()[0]
    assert total == pytest.approx(values.sum(), rel=1e-5)
    assert turn == 8


def test_pandas_reads_steps(run_files: Path) -> None:
    """A frame with the agents' returns."""
    frame = pd.read_parquet(run_files / "agent_steps.parquet")
    assert frame.groupby("agent")["reward"].sum().to_dict() == {"carrier_0": 12, "picker_0": 12}
    assert frame["turn"].tolist() == read(run_files).agent_steps["turn"].to_pylist()


def test_polars_reads_every_table(run_files: Path) -> None:
    """Polars, with a reader of its own, gives the same values."""
    for name in ("episodes", "agent_steps", "states", "timings"):
        expected = getattr(read(run_files), name)
        assert pl.read_parquet(run_files / f"{name}.parquet").to_dicts() == expected.to_pylist()


def test_any_arrow_library_reads_a_segment(tmp_path: Path) -> None:
    """A segment that was ended regularly is a plain Arrow stream."""
    writer = SegmentWriter(tmp_path / "agent_steps-0000.arrows", run_folders.steps(0, 0, 1).schema)
    batches = [run_folders.steps(0, turn, turn + 1) for turn in range(3)]
    for batch in batches:
        writer.write(batch)
    writer.finish()
    with pa.OSFile(str(writer.path)) as source:
        assert pa.ipc.open_stream(source).read_all() == pa.Table.from_batches(batches)
    assert pl.read_ipc_stream(writer.path).height == 6


def test_tables_are_encoded_for_what_they_hold(run_files: Path) -> None:
    """Floats (in lists too) and turns are split by byte, counters differences, agents looked up."""
    group = pq.read_metadata(run_files / "agent_steps.parquet").row_group(0)
    columns = {group.column(i).path_in_schema: group.column(i) for i in range(group.num_columns)}
    for name, encoding in {
        "obs.list.element": "BYTE_STREAM_SPLIT",
        "turn": "BYTE_STREAM_SPLIT",
        "episode": "DELTA_BINARY_PACKED",
        "agent": "RLE_DICTIONARY",
    }.items():
        assert encoding in columns[name].encodings, name
        assert columns[name].compression == "ZSTD"


def test_table_reader_gives_some_columns_and_groups(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A column's name names no other that begins with it; groups come in the order asked for."""
    monkeypatch.setattr(table_writer, "GROUP_ROWS", 4)
    batch = run_folders.steps(0, 0, 6).append_column("reward.delivery", pa.array(range(12)))
    path, _, _ = write_table(tmp_path, "agent_steps", batch.schema, [batch])
    reader = TableReader(path, "agent_steps")
    assert reader.groups == 3
    some = reader.read(columns={"reward", "turn", "obs"}, groups=[2, 0])
    assert some.column_names == ["turn", "obs", "reward"]
    assert some["turn"].to_pylist() == [4, 4, 5, 5, 0, 0, 1, 1]
    assert some["obs"].to_pylist()[4:] == batch["obs"].to_pylist()[:4]


def test_row_groups_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However large a batch is, a row group holds a bounded number of rows and bytes."""
    monkeypatch.setattr(table_writer, "GROUP_ROWS", 100)
    batch = run_folders.steps(0, 0, 130)
    path, size, _ = write_table(
        tmp_path, "agent_steps", batch.schema, [batch, run_folders.steps(0, 130, 131)]
    )
    metadata = pq.read_metadata(path)
    rows = [metadata.row_group(i).num_rows for i in range(metadata.num_row_groups)]
    assert rows == [100, 100, 62]
    assert path.stat().st_size == size
    monkeypatch.setattr(table_writer, "GROUP_BYTES", 300)
    path, _, _ = write_table(tmp_path, "agent_steps", batch.schema, [batch.slice(0, 20)])
    metadata = pq.read_metadata(path)
    assert all(metadata.row_group(i).num_rows <= 16 for i in range(metadata.num_row_groups))
    assert (
        TableReader(path, "agent_steps").read().equals(pa.Table.from_batches([batch.slice(0, 20)]))
    )


FLOATS = st.floats(width=32) | st.none()
LISTS = st.lists(FLOATS, min_size=3, max_size=3) | st.none()


@given(
    st.lists(
        st.tuples(LISTS, st.text() | st.none(), st.binary() | st.none(), FLOATS, st.booleans()),
        max_size=8,
    )
)
def test_values_come_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[object, ...]]
) -> None:
    """NaN, -0.0, infinities, empty text and nulls survive segments and tables."""
    kinds = (pa.list_(pa.float32(), 3), pa.string(), pa.binary(), pa.float32(), pa.bool_())
    columns = [pa.array([row[i] for row in rows], kind) for i, kind in enumerate(kinds)]
    nested = pa.StructArray.from_arrays(columns[:2], ["list", "text"])
    keys = [pa.array(range(len(rows)), pa.int32())] * 2
    names = ["episode", "turn", "list", "text", "bytes", "float", "bool", "nested"]
    batch = pa.record_batch([*keys, *columns, nested], names=names)
    folder = tmp_path_factory.mktemp("b")
    writer = SegmentWriter(folder / "agent_steps-0000.arrows", batch.schema)
    writer.write(batch)
    writer.finish()
    (found,) = SegmentReader(writer.path, "agent_steps")
    assert _bits(found) == _bits(batch)
    path, _, _ = write_table(folder, "agent_steps", batch.schema, [batch])
    table = TableReader(path, "agent_steps").read()
    assert table.schema.equals(batch.schema)
    assert [_bits(part) for part in table.to_batches()] == [_bits(batch)] * bool(rows)


def _bits(batch: pa.RecordBatch) -> list[str]:
    """Rows as text that tells -0.0 from 0.0 and NaN from null."""
    return [repr(row) for row in batch.to_pylist()]


@pytest.mark.parametrize(
    ("rewards", "encoding"),
    [
        ([k / 7 for k in range(96)], "BYTE_STREAM_SPLIT"),
        ([k // 3 / 7 for k in range(96)], "PLAIN"),
        ([float(k % 3) for k in range(96)], "RLE_DICTIONARY"),
    ],
    ids=["each its own", "agents alike", "a few values"],
)
def test_rewards_are_encoded_by_how_often_they_come(
    tmp_path: Path, rewards: list[float], encoding: str
) -> None:
    """A column of floats is split by byte, left plain or given a dictionary, and reads back."""
    keys = pa.array(range(96), pa.int32())
    table = pa.table({"episode": keys, "turn": keys, "reward": rewards})
    path, _, _ = write_table(tmp_path, "agent_steps", table.schema, table.to_batches())
    column = pq.read_metadata(path).row_group(0).column(2)
    assert encoding in column.encodings
    assert ("RLE_DICTIONARY" in column.encodings) is (encoding == "RLE_DICTIONARY")
    assert pq.read_table(path)["reward"].to_pylist() == rewards
