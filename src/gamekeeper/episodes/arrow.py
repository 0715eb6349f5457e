"""Blocks as Arrow record batches, and back: what the files of a run hold."""

import json
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.episodes.actions_level import WITNESS
from gamekeeper.episodes.block import (
    Block,
    Cells,
    Coded,
    Raw,
    States,
    Text,
    element_bytes,
    most_rows,
)
from gamekeeper.episodes.layout import Column, leaf_columns, length_of
from gamekeeper.errors import EvidenceError

NUMBERS: Final = {
    "order": ("<i2", pa.int16()),
    "cumulative_reward": ("<f8", pa.float64()),
    "reward": ("<f8", pa.float64()),
}
FLAGS: Final = ("terminated", "truncated")
TEXTS: Final = ("info", "raised", "nonconforming")
TERM: Final = "reward."


def steps_batch(block: Block, *, digests: Any | None = None) -> pa.RecordBatch:
    """The rows of `block` as a record batch.

    Args:
        digests: [rows, 16]; where given, they stand in place of the observations (level "digest").
    """
    fields: dict[pa.Field, pa.Array] = {}

    def put(name: str, array: pa.Array) -> None:
        fields[pa.field(name, array.type)] = array

    put("episode", pa.array(block.episode))
    put("turn", pa.array(block.turn))
    put("agent", names_array(block.agent))
    put("order", _number(block.order, "order"))
    for name, (column, cells) in block.values.items():
        if digests is None or not name.startswith("obs"):
            field, array = cells_field(column, cells)
            fields[field] = array
    put("action_mask", _masks(block.mask, len(block)))
    put("cumulative_reward", _number(block.cumulative_reward, "cumulative_reward"))
    put("terminated", _flag(block.terminated))
    put("truncated", _flag(block.truncated))
    put("info", _texts(block.info, len(block)))
    put("reward", _number(block.reward, "reward"))
    for term, raw in block.terms.items():
        put(TERM + term, _number(raw, "reward"))
    put("live", pa.array(block.live))
    put("raised", _texts(block.raised, len(block)))
    put("nonconforming", _texts(block.nonconforming, len(block)))
    if block.witness is not None:
        put("observed", pa.array(block.observed))
        put("digest", _present_bytes(block.witness))
    elif digests is not None:
        put("digest", binary_array(np.ascontiguousarray(digests)))
    return pa.RecordBatch.from_arrays(list(fields.values()), schema=pa.schema(list(fields)))


def states_batch(states: States) -> pa.RecordBatch:
    """States as a record batch."""
    columns = [
        (pa.field("episode", pa.int32()), pa.array(states.episode)),
        (pa.field("turn", pa.int32()), pa.array(states.turn)),
    ]
    columns += [cells_field(column, cells) for column, cells in states.cells]
    texts = pa.array(states.nonconforming, pa.string())
    columns.append((pa.field("nonconforming", pa.string()), texts))
    fields, arrays = zip(*columns, strict=True)
    return pa.RecordBatch.from_arrays(list(arrays), schema=pa.schema(list(fields)))


def cells_field(column: Column, cells: Cells) -> tuple[pa.Field, pa.Array]:
    """One value column as an Arrow field, its leaf in the metadata, and array."""
    array = _cells(column, cells)
    return _field(column, array.type), array


@lru_cache(maxsize=1024)
def _field(column: Column, kind: pa.DataType) -> pa.Field:
    leaf, shape = column.leaf, list(column.leaf.shape)
    described = {"path": leaf.path, "kind": leaf.kind, "dtype": leaf.dtype, "shape": shape}
    metadata = {"tag": column.tag, "leaf": json.dumps(described), "shape": json.dumps(shape)}
    return pa.field(column.name, kind, metadata=metadata)


def blocks_of(table: pa.Table) -> Iterator[Block]:
    """The rows of a `steps` table as blocks of whole turns, of as many rows as suit its columns."""
    for start, end in turn_bounds(table, most_rows(leaf_columns(table.schema))):
        yield block_of_table(table.slice(start, end - start))


def turn_bounds(table: pa.Table, most: int) -> Iterator[tuple[int, int]]:
    """Bounds of the parts of a table that is sorted by turn.

    Each has at most so many rows, or is one turn of more.
    """
    if table.num_rows <= most:
        yield from [(0, table.num_rows)] if table.num_rows else []
        return
    episode, turn = table["episode"].to_numpy(), table["turn"].to_numpy()
    firsts = np.flatnonzero(np.diff(episode, prepend=-1) | np.diff(turn, prepend=-1))
    start = 0
    while start < table.num_rows:
        end = table.num_rows
        if end - start > most:
            place = int(np.searchsorted(firsts, start + most, side="right")) - 1
            place += firsts[place] <= start  # a turn of more rows stays whole
            end = int(firsts[place]) if place < len(firsts) else end
        yield start, end
        start = end


def block_of_table(table: pa.Table) -> Block:
    """A `steps` table as one block."""
    table = table.combine_chunks()
    values = {
        column.name: (column, cells_of(column, table[column.name]))
        for column in leaf_columns(table.schema)
    }
    terms = {
        name[len(TERM) :]: _raw_number(table[name], "<f8")
        for name in table.schema.names
        if name.startswith(TERM)
    }
    cells: dict[str, Any] = {n: _raw_number(table[n], dtype) for n, (dtype, _) in NUMBERS.items()}
    cells |= {name: _raw_number(table[name].cast(pa.uint8()), "|u1") for name in FLAGS}
    cells |= {name: table[name].to_pylist() for name in TEXTS}
    return Block(
        episode=table["episode"].to_numpy(),
        turn=table["turn"].to_numpy(),
        agent=table["agent"].to_pylist(),
        values=values,
        mask=table["action_mask"].to_pylist(),
        live=table["live"].to_numpy(zero_copy_only=False).astype(np.bool_),
        terms=terms,
        **_kept(table),
        **cells,
    )


def _kept(table: pa.Table) -> dict[str, Any]:
    """Columns that stand at level `actions` alone."""
    if "observed" not in table.schema.names:
        return {}
    digests = table["digest"].to_pylist()
    blank = bytes(WITNESS)
    values = np.frombuffer(b"".join([each or blank for each in digests]), np.uint8)
    return {
        "observed": table["observed"].to_numpy(zero_copy_only=False).astype(np.bool_),
        "witness": Raw(
            values.reshape(len(digests), WITNESS),
            np.fromiter((each is not None for each in digests), np.bool_, len(digests)),
        ),
    }


def cells_of(column: Column, array: pa.ChunkedArray) -> Cells:
    """One value column as raw elements or texts."""
    kind = column.leaf.kind
    if kind in ("text", "json"):
        return Text(array.to_pylist())
    if kind == "int":
        return _raw_number(array, "<i8")
    whole = _whole(array)
    valid = ~np.asarray(whole.is_null())
    size = element_bytes(column)
    if not size:
        return Raw(np.zeros((len(whole), 0), np.uint8), valid)
    if kind == "bytes":
        parts = [
            part if part is not None and len(part) == size else bytes(size)
            for part in whole.to_pylist()
        ]
        return Raw(np.frombuffer(b"".join(parts), np.uint8).reshape(len(parts), size), valid)
    length = whole.type.list_size
    values = whole.values[whole.offset * length : (whole.offset + len(whole)) * length]
    flat = np.asarray(values.fill_null(0) if values.null_count else values)
    raw = np.ascontiguousarray(flat, np.dtype(column.leaf.dtype)).view(np.uint8)
    return Raw(raw.reshape(len(whole), size), valid)


def _cells(column: Column, cells: Cells) -> pa.Array:
    if isinstance(cells, Text):
        return pa.array(cells.values, pa.string())
    if column.leaf.kind == "int":
        return pa.array(cells.values.view(np.int64)[:, 0], mask=~cells.valid)
    if column.leaf.kind == "bytes" or not cells.values.shape[1]:
        return binary_array(cells.values, cells.valid)
    flat = np.ascontiguousarray(cells.values).view(column.leaf.dtype).reshape(-1)
    mask = None if cells.valid.all() else pa.array(~cells.valid)
    length = flat.size // max(len(cells.values), 1) or length_of(column.leaf)
    return pa.FixedSizeListArray.from_arrays(pa.array(flat), length, mask=mask)


def binary_array(values: Any, valid: Any | None = None) -> pa.Array:
    """Rows of bytes [rows, size] as a binary array, without a copy of the bytes."""
    values = np.ascontiguousarray(values)
    count, size = values.shape
    if values.nbytes > np.iinfo(np.int32).max:
        raise EvidenceError(
            "a batch holds more bytes than one column of it can",
            expected="at most 2 GiB",
            actual=f"{count} rows of {size} bytes",
            fix="take fewer rows at a time (`most_rows`)",
        )
    offsets = pa.py_buffer((np.arange(count + 1) * size).astype(np.int32))
    bits = None
    if valid is not None and not valid.all():
        bits = pa.py_buffer(np.packbits(valid, bitorder="little"))
    return pa.Array.from_buffers(pa.binary(), count, [bits, offsets, pa.py_buffer(values)])


def _present_bytes(raw: Raw) -> pa.Array:
    """The same of a column that mostly is null: null elements take no bytes."""
    ends = np.cumsum(raw.valid, dtype=np.int32) * np.int32(raw.values.shape[1])
    offsets = np.concatenate((np.zeros(1, np.int32), ends))
    bits = np.packbits(raw.valid, bitorder="little")
    parts = (bits, offsets, np.ascontiguousarray(raw.values[raw.valid]))
    return pa.Array.from_buffers(pa.binary(), len(raw.valid), [pa.py_buffer(p) for p in parts])


def names_array(names: list[str] | Coded) -> pa.Array:
    """Names of agents as an Arrow array."""
    if isinstance(names, Coded):
        return pa.array(names.names, pa.string()).take(pa.array(names.codes))
    return pa.array(names, pa.string())


def _texts(texts: Any, count: int) -> pa.Array:
    if texts is None:
        return pa.nulls(count, pa.string())
    return texts if isinstance(texts, pa.Array) else pa.array(texts, pa.string())


def _masks(masks: list[bytes | None] | dict[int, Raw], count: int) -> pa.Array:
    if not isinstance(masks, dict):
        if masks.count(None) == count:
            return pa.nulls(count, pa.binary())
        return pa.array(masks, pa.binary())
    arrays = [binary_array(raw.values, raw.valid) for raw in masks.values()]
    if len(arrays) < 2:
        return arrays[0] if arrays else pa.nulls(count, pa.binary())
    return pc.coalesce(*arrays)


def _number(raw: Raw, name: str) -> pa.Array:
    dtype, kind = NUMBERS[name]
    if not raw.valid.any():
        return pa.nulls(len(raw.valid), kind)
    return pa.array(
        raw.values.view(dtype)[:, 0], kind, mask=None if raw.valid.all() else ~raw.valid
    )


def _flag(raw: Raw) -> pa.Array:
    return pa.array(raw.values[:, 0].astype(np.bool_), mask=None if raw.valid.all() else ~raw.valid)


def _raw_number(array: pa.ChunkedArray, dtype: str) -> Raw:
    whole = _whole(array)
    valid = ~np.asarray(whole.is_null())
    filled = np.asarray(whole.fill_null(0) if whole.null_count else whole)
    values = np.ascontiguousarray(filled, np.dtype(dtype))
    return Raw(values.view(np.uint8).reshape(len(values), values.itemsize), valid)


def _whole(array: pa.ChunkedArray) -> pa.Array:
    chunks = array.chunks
    if len(chunks) == 1:
        return chunks[0]
    return pa.concat_arrays(chunks) if chunks else pa.array([], array.type)
