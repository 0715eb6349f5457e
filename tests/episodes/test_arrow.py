"""Blocks go into record batches and come back bit for bit, sliced or whole, through Parquet too."""

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from gymnasium.spaces import Box, Dict, Space
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.episodes import arrow
from gamekeeper.episodes.arrow import block_of_table, turn_bounds
from gamekeeper.episodes.digest import row_digests
from gamekeeper.episodes.layout import value_columns
from gamekeeper.errors import EvidenceError
from tests.episodes.buffers import Given, record
from tests.episodes.drawn_spaces import FIXED, sample


def steps_of(space: Space[Any], seed: int) -> pa.Table:
    """Rows of two agents, some of them null, some odd."""
    values = [sample(space, seed), "nonconforming", sample(space, seed + 1)]
    return record(Given({"a": values, "b": values[1:]}, {"a": space, "b": space}), 5).agent_steps


@settings(max_examples=40)
@given(FIXED, st.integers(0, 9), st.integers(0, 6), st.integers(1, 6))
def test_slices_of_a_table_digest_as_its_rows(
    space: Space[Any], seed: int, start: int, length: int
) -> None:
    """Offsets of Arrow's lists, binaries and bits are minded."""
    steps = steps_of(space, seed)
    whole = row_digests(block_of_table(steps))
    part = row_digests(block_of_table(steps.slice(start, length)))
    assert np.array_equal(whole[start : start + length], part)
    chunks = pa.concat_tables([steps.slice(0, start), steps.slice(start)])
    assert np.array_equal(whole, row_digests(block_of_table(chunks)))
    parts = [steps.slice(at, end - at) for at, end in turn_bounds(steps, length)]
    few = [row_digests(block_of_table(part)) for part in parts]
    assert np.array_equal(whole, np.concatenate(few))


@settings(max_examples=15)
@given(FIXED, st.integers(0, 9))
def test_parquet_keeps_every_bit(space: Space[Any], seed: int) -> None:
    """Nulls, NaN, fixed-size lists, binaries."""
    steps = steps_of(space, seed)
    sink = pa.BufferOutputStream()
    pq.write_table(steps, sink, compression="zstd")
    back = pq.read_table(pa.BufferReader(sink.getvalue()))
    assert np.array_equal(row_digests(block_of_table(steps)), row_digests(block_of_table(back)))


def test_columns_say_what_they_hold() -> None:
    """Path, kind, dtype and shape stand in a field's metadata."""
    space = Dict({"x": Box(0, 1, (2, 3), np.float32), "y": Box(0, 255, (4,), np.uint8)})
    steps = steps_of(space, 1)
    columns = value_columns(steps.schema, "obs")
    assert [(column.name, column.leaf.dtype, column.leaf.shape) for column in columns] == [
        ("obs.x", "<f4", (2, 3)),
        ("obs.y", "|u1", (4,)),
    ]
    assert steps.schema.field("obs.x").type == pa.list_(pa.float32(), 6)
    assert steps.schema.field("obs.y").type == pa.binary()
    assert steps.schema.field("obs.x").metadata[b"shape"] == b"[2, 3]"
    assert [column.name for column in value_columns(steps.schema, "action")] == ["action"]


def test_batch_beyond_two_gigabytes_is_refused() -> None:
    """Arrow's offsets would wrap round."""
    rows = np.lib.stride_tricks.as_strided(np.zeros(1, np.uint8), (3, 1 << 30), (0, 0))

    class Huge:
        """Says that it is large, and isn't."""

        shape, nbytes = rows.shape, rows.nbytes

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arrow.np, "ascontiguousarray", lambda values: Huge())
        with pytest.raises(EvidenceError, match="more bytes"):
            arrow.binary_array(rows)
