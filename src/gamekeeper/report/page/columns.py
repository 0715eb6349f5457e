"""The rows of an episode as columns of a page, made without a look at each row."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gamekeeper.core.arrow import TERM, cells_of
from gamekeeper.core.block import Raw
from gamekeeper.core.layout import Column
from gamekeeper.core.leaf_columns import value_columns
from gamekeeper.core.trace import MASK
from gamekeeper.report.page.plain import (
    DIGITS,
    Values,
    plain_array,
    plain_of_text,
    rounded,
)

Places = NDArray[np.int64]
NONE: Final = -1
"""The place of what isn't there."""


def row_columns(steps: pa.Table, agents: Sequence[str], values: Values) -> dict[str, Any]:
    """All columns of a packed episode; `values` takes what they only name the places of.

    Args:
        steps: the rows of one episode in the order turn, order, agent.
        agents: every agent that has a row.
        values: filled with actions, masks and infos.
    """
    steps = steps.combine_chunks()
    columns: dict[str, Any] = {
        "turn": steps["turn"].to_pylist(),
        "agent": pc.index_in(steps["agent"], pa.array(list(agents), pa.string())).to_pylist(),
        "order": steps["order"].to_pylist(),
        "action": _listed(_actions(steps, values)),
        "received": _numbers(steps["received"]),
        "reward": _numbers(steps["reward"]),
        "terms": {
            name[len(TERM) :]: _numbers(steps[name])
            for name in steps.schema.names
            if name.startswith(TERM)
        },
        "terminated": steps["terminated"].cast(pa.int8()).to_pylist(),
        "truncated": steps["truncated"].cast(pa.int8()).to_pylist(),
        "mask": _listed(_masks(steps, values)),
        "info": _listed(_infos(steps, values)),
    }
    return _with_odd(columns, steps, values)


def leaf_places(column: Column, array: pa.ChunkedArray, values: Values) -> Places:
    """[rows] the places of one leaf's values; `NONE` where it is null."""
    if column.leaf.kind in ("int", "text", "json"):
        read = plain_of_text if column.leaf.kind == "json" else rounded
        return _coded(array, lambda value: values.place(read(value)))
    raw = cells_of(column, array)
    if not isinstance(raw, Raw):  # texts are done above
        return np.full(len(array), NONE)
    return _raw_places(raw, column, values)


def _raw_places(raw: Raw, column: Column, values: Values) -> Places:
    count, size = raw.values.shape
    places = np.full(count, NONE)
    if not size or not raw.valid.any():
        places[raw.valid] = values.place([])
        return places
    rows = np.ascontiguousarray(raw.values[raw.valid]).view(f"V{size}")[:, 0]
    unique, inverse = np.unique(rows, return_inverse=True)
    dtype, shape = np.dtype(column.leaf.dtype), column.leaf.shape
    found = [
        values.place(plain_array(np.frombuffer(each.tobytes(), dtype).reshape(shape)))
        for each in unique
    ]
    places[raw.valid] = np.array(found)[inverse]
    return places


def _actions(steps: pa.Table, values: Values) -> Places:
    """Of spaces of several leaves, an object by path; agents may have columns of their own."""
    columns = value_columns(steps.schema, "action")
    count = steps.num_rows
    if not columns:
        return np.full(count, NONE)
    if len(columns) == 1 and not columns[0].leaf.path:
        return leaf_places(columns[0], steps[columns[0].name], values)
    leaves = Values()
    parts = np.stack([leaf_places(each, steps[each.name], leaves) for each in columns], axis=1)
    unique, inverse = np.unique(parts, axis=0, return_inverse=True)
    found = [_joined(row, columns, leaves, values) for row in unique.tolist()]
    return np.array(found, np.int64)[inverse.reshape(-1)]


def _joined(row: Sequence[int], columns: Sequence[Column], leaves: Values, values: Values) -> int:
    held = {
        column.leaf.path: leaves.items[place]
        for column, place in zip(columns, row, strict=True)
        if place != NONE
    }
    if not held:
        return NONE
    return values.place(held[""] if list(held) == [""] else held)


def _masks(steps: pa.Table, values: Values) -> Places:
    """Masks from infos, else those that stand in observations."""
    masks = steps["mask"]
    if masks.null_count < len(masks):
        infos = steps["info"]
        first = {m: k for k, m in reversed(list(enumerate(masks.to_pylist()))) if m is not None}
        return _coded(
            masks, lambda mask: values.place(_mask(mask, _described(infos[first[mask]].as_py())))
        )
    for column in value_columns(steps.schema, "obs"):
        if column.leaf.path == MASK:
            return leaf_places(column, steps[column.name], values)
    return np.full(steps.num_rows, NONE)


def _described(info: str | None) -> str:
    """What an info says of the mask that was taken out of it: `int8 5`."""
    try:
        told = json.loads(info or "{}").get(MASK)
    except (AttributeError, ValueError, RecursionError):
        told = None
    return told if isinstance(told, str) else ""


def _mask(mask: bytes, described: str) -> Any:
    dtype, _, shape = described.partition(" ")
    try:
        array = np.frombuffer(mask, dtype or "uint8")
        return plain_array(array.reshape([int(n) for n in shape.split("x") if n] or -1))
    except (TypeError, ValueError):
        return plain_array(np.frombuffer(mask, np.uint8))


def _infos(steps: pa.Table, values: Values) -> Places:
    """Empty infos aren't shown, and a mask stands in its own column."""

    def place(text: str) -> int:
        value = plain_of_text(text, without=(MASK,))
        return NONE if value == {} else values.put(value, text)  # every text comes once

    return _coded(steps["info"], place)


def _coded(array: pa.ChunkedArray, place: Any) -> Places:
    """[rows] a place for each row, asked for once for every distinct value."""
    coded = array.combine_chunks()
    coded = coded.chunk(0) if isinstance(coded, pa.ChunkedArray) else coded
    coded = coded.dictionary_encode()
    found = np.array([place(value) for value in coded.dictionary.to_pylist()], np.int64)
    indices = coded.indices.fill_null(NONE).to_numpy(zero_copy_only=False).astype(np.int64)
    if not len(found):
        return np.full(len(indices), NONE)
    return np.where(indices == NONE, NONE, found[indices])


def _listed(places: Places) -> list[int | None]:
    listed: list[int | None] = places.tolist()
    if (places == NONE).any():
        return [None if place == NONE else place for place in listed]
    return listed


def _numbers(array: pa.ChunkedArray) -> list[float | int | None]:
    """Numbers with as many digits as are shown, whole ones without a point; odd ones are null."""
    numbers = array.to_numpy()
    unique, inverse = np.unique(numbers, return_inverse=True)  # NaN once: null, or odd
    spelled = [_number(value) for value in unique.tolist()]
    return [spelled[place] for place in inverse.tolist()]


def _number(value: float) -> float | int | None:
    if not np.isfinite(value):
        return None
    short = float(f"{value:.{DIGITS + 2}g}")
    return int(short) if short.is_integer() and abs(short) < 2**53 else short


def _with_odd(columns: dict[str, Any], steps: pa.Table, values: Values) -> dict[str, Any]:
    """Adds what wasn't as declared: its field, type and value, and numbers that aren't finite."""
    found: dict[int, dict[str, Any]] = {}
    strange = steps["odd"]
    if strange.null_count < len(strange):
        for row, text in enumerate(strange.to_pylist()):
            if text is not None:
                found[row] = _odd_fields(text)
    for name in ("received", "reward"):
        finite = pc.is_finite(steps[name]).fill_null(True)
        for row in np.flatnonzero(~finite.to_numpy(zero_copy_only=False)).tolist():
            found.setdefault(row, {})[name] = str(steps[name][row].as_py())
    odd: list[int | None] = [None] * steps.num_rows
    for row, fields in found.items():
        odd[row] = values.place(fields)
        for name in ("action", "info"):
            if name in fields and columns[name][row] is None:
                columns[name][row] = values.place(fields[name])
    return {**columns, "odd": odd}


def _odd_fields(text: str) -> dict[str, Any]:
    fields = plain_of_text(text)
    if not isinstance(fields, Mapping):
        return {"row": fields}
    return {
        name: f"{entry.get('type')}: {json.dumps(entry.get('value'))}"
        if isinstance(entry, Mapping)
        else entry
        for name, entry in fields.items()
    }
