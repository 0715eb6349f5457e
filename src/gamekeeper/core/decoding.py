"""One value at a time out of the columns of a trace."""

from __future__ import annotations

import json
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.core.arrow import cells_of
from gamekeeper.core.block import Cells, Raw
from gamekeeper.core.canon import from_json
from gamekeeper.core.layout import Column
from gamekeeper.core.leaf_columns import value_columns
from gamekeeper.core.space import Codec

# scalars that canonical JSON writes as plain values
_SCALARS: Final[dict[str | None, Any]] = {
    "numpy.bool": np.bool_,
    "numpy.bool_": np.bool_,
    "numpy.int64": np.int64,
    "numpy.float64": np.float64,
    "numpy.str_": np.str_,
}


def cells_by_column(table: pa.Table, kind: str) -> list[tuple[Column, Cells]]:
    """The columns of a table that hold leaves of `kind`, with what is in them."""
    return [
        (column, cells_of(column, table[column.name]))
        for column in value_columns(table.schema, kind)
    ]


def value_at(codec: Codec | None, cells: list[tuple[Column, Cells]], row: int) -> Any:
    """One value from the columns that hold the leaves of `codec`, or None where they are null."""
    payloads = None if codec is None else payloads_at(codec, cells, row)
    return None if codec is None or payloads is None else codec.unpack(payloads)


def payloads_at(
    codec: Codec, cells: list[tuple[Column, Cells]], row: int
) -> tuple[Any, ...] | None:
    """What the leaves of one value hold, or None where one of them is null."""
    payloads = []
    for leaf in codec.leaves:
        found = (_payload(column, each, row) for column, each in cells if column.leaf == leaf)
        payload = next(found, None)
        if payload is None:
            return None
        payloads.append(payload)
    return tuple(payloads)


def _payload(column: Column, cells: Cells, row: int) -> Any:
    if not isinstance(cells, Raw):
        return cells.values[row]
    if not cells.valid[row]:
        return None
    payload = cells.values[row].tobytes()
    return int.from_bytes(payload, "little", signed=True) if column.leaf.kind == "int" else payload


def mask_of(text: str, payload: bytes) -> Any:
    """An action mask from its dtype and shape, as `int8 5`, and its bytes."""
    dtype, _, shape = text.partition(" ")
    return np.frombuffer(payload, dtype).reshape([int(n) for n in shape.split("x") if n]).copy()


def object_of(text: str) -> dict[str, Any]:
    """A JSON object from its text.

    Raises:
        ValueError: it is something else.
    """
    found = json.loads(text)
    if not isinstance(found, dict):
        raise ValueError(f"{text[:40]!r} is no JSON object")
    return found


def odd_of(text: str) -> dict[str, Any]:
    """The odd fields of a row: the name of a type, and the value but for what was missing."""
    fields = object_of(text)
    for entry in fields.values():
        if "value" in entry:
            value = from_json(json.dumps(entry["value"]))
            scalar = _SCALARS.get(entry.get("type"))
            is_plain = isinstance(value, bool | int | float | str)
            entry["value"] = scalar(value) if scalar is not None and is_plain else value
    return fields


def places_of(items: list[Any]) -> dict[Any, int]:
    """By item, where it stands."""
    return {item: place for place, item in enumerate(items)}
