"""Recorded values as plain JSON for a page, bounded in size."""

import json
import math
import struct
import zlib
from base64 import b64decode, b64encode
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gamekeeper.episodes.arrow import TERM, cells_of
from gamekeeper.episodes.block import Raw
from gamekeeper.episodes.episode import MASK
from gamekeeper.episodes.layout import Column, value_columns

MOST_CHARACTERS: Final = 2_000
"""Longest text of one value on the page; the run has all of it."""
MOST_ELEMENTS: Final = 512
DEEPEST: Final = 32
DIGITS: Final = 7
"""Significant digits of a number on the page: what a 32-bit float has."""


class PackedValues:
    """Plain values, each stored once and referred to by its place."""

    def __init__(self) -> None:
        self.items: list[Any] = []
        self._places: dict[str, int] = {}

    def place(self, value: Any) -> int:
        """The place of a plain value."""
        text = json.dumps(value, sort_keys=True)
        if text not in self._places:
            self._places[text] = self.put(value, text)
        return self._places[text]

    def put(self, value: Any, text: str) -> int:
        """Stores a value that is known to be new, cut where its text is long."""
        if len(text) > MOST_CHARACTERS:
            text = json.dumps(value)
            if len(text) > MOST_CHARACTERS:
                value = f"{text[:MOST_CHARACTERS]}… ({len(text):,} characters)"
        self.items.append(value)
        return len(self.items) - 1


def plain_of_text(text: str, *, without: Iterable[str] = ()) -> Any:
    """A canonical JSON text as plain JSON; the text itself where it can't be read.

    Args:
        text: as `episodes.canonical.to_json` writes it.
        without: fields that are left out, as they are shown elsewhere.
    """
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return text
    if isinstance(value, dict) and "$" not in value:
        for key in without:
            value.pop(key, None)
    try:
        return _plain(value, 0)
    except (ArithmeticError, LookupError, TypeError, ValueError):
        return text


def fields_of_text(text: str | None) -> dict[str, Any]:
    """The object of a canonical JSON text as plain JSON; empty where it isn't one."""
    value = plain_of_text(text) if text else {}
    return {str(key): each for key, each in value.items()} if isinstance(value, Mapping) else {}


def plain_array(array: Any) -> Any:
    """An array as nested lists, a number if it has no dimensions, its shape if it is large."""
    if array.size > MOST_ELEMENTS:
        return f"array {array.dtype} {list(array.shape)}"
    return rounded(array.tolist())


def rounded(value: Any) -> Any:
    """Rounds numbers to the digits that a page shows; writes NaN and infinity as text."""
    if isinstance(value, float):
        return (
            float(f"{value:.{DIGITS}g}") if math.isfinite(value) else _nonconforming_number(value)
        )
    if isinstance(value, list):
        return [rounded(item) for item in value]
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if isinstance(value, complex):
        return str(value)
    return value


def _nonconforming_number(value: float) -> str:
    return "NaN" if math.isnan(value) else "inf" if value > 0 else "-inf"


def _plain(value: Any, depth: int) -> Any:
    if depth > DEEPEST:
        return "…"
    if isinstance(value, list):
        return [_plain(item, depth + 1) for item in value]
    if not isinstance(value, dict):
        return rounded(value)
    if "$" in value:
        return _special(value, depth)
    return {key: _plain(item, depth + 1) for key, item in value.items()}


def _special(value: Mapping[str, Any], depth: int) -> Any:
    """The closest plain JSON of a value that JSON doesn't have."""
    kind, inner = value["$"], value.get("v")
    if kind in ("nan", "inf", "-inf"):
        return "NaN" if kind == "nan" else kind
    if kind in ("tuple", "set", "frozenset", "range", "complex"):
        return [_plain(item, depth + 1) for item in inner or ()]
    if kind == "ndarray":
        return _array(value, depth)
    if kind == "dict":
        return {_key(key): _plain(item, depth + 1) for key, item in inner or ()}
    if kind in ("bytes", "bytearray", "bytes_"):
        return f"{len(b64decode(str(inner)))} bytes"
    if kind == "object":
        return str(value.get("repr") or value.get("type"))
    if isinstance(inner, bool | int | float | str | list):
        return _plain(inner, depth + 1)
    return json.dumps(value)


def _array(value: Mapping[str, Any], depth: int) -> Any:
    shape, items = value["shape"], value["v"]
    if isinstance(items, str):
        dtype = str(value["dtype"])
        count = math.prod(shape)
        if count > MOST_ELEMENTS or np.dtype(dtype).kind not in "biuf":
            return f"array {dtype} {shape}"
        return plain_array(np.frombuffer(b64decode(items), dtype, count).reshape(shape))
    flat = [_plain(item, depth + 1) for item in items]
    return _nested(flat, list(shape))


def _nested(flat: list[Any], shape: list[int]) -> Any:
    if not shape:
        return flat[0] if flat else None
    for length in reversed(shape[1:]):
        flat = [flat[at : at + length] for at in range(0, len(flat), max(length, 1))]
    return flat


def _key(key: Any) -> str:
    return key if isinstance(key, str) else json.dumps(_plain(key, DEEPEST - 2))


SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
COLOURS: Final = {1: 0, 3: 2, 4: 6}
"""PNG's number for grey, rgb and rgb with alpha, by channels. Source: PNG (2nd ed.), 11.2.2."""


def png(pixels: NDArray[np.uint8]) -> bytes:
    """A picture of [height, width, 1, 3 or 4] as the bytes of a PNG file."""
    height, width, channels = pixels.shape
    head = struct.pack(">IIBBBBB", width, height, 8, COLOURS[channels], 0, 0, 0)
    lines = np.zeros((height, width * channels + 1), np.uint8)  # a filter type before each line
    lines[:, 1:] = pixels.reshape(height, width * channels)
    body = zlib.compress(lines.tobytes(), 9)
    return SIGNATURE + _chunk(b"IHDR", head) + _chunk(b"IDAT", body) + _chunk(b"IEND", b"")


def data_url(picture: bytes) -> str:
    """A PNG file as a data URL."""
    return "data:image/png;base64," + b64encode(picture).decode("ascii")


def is_picture(pixels: NDArray[np.generic]) -> bool:
    """Tells if an array has the form of a picture: 8-bit, at least 8 by 8, grey or coloured."""
    return (
        pixels.dtype == np.uint8
        and pixels.ndim == 3
        and pixels.shape[2] in COLOURS
        and min(pixels.shape[:2]) >= 8
    )


def _chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


Places = NDArray[np.int64]
NONE: Final = -1
"""Place of a value that is missing."""


def row_columns(steps: pa.Table, agents: Sequence[str], values: PackedValues) -> dict[str, Any]:
    """All columns of a packed episode; values that columns refer to are put into `values`.

    Args:
        steps: the rows of one episode in the order turn, order, agent.
        agents: every agent that has a row.
        values: is filled with actions, masks and infos.
    """
    steps = steps.combine_chunks()
    columns: dict[str, Any] = {
        "turn": steps["turn"].to_pylist(),
        "agent": pc.index_in(steps["agent"], pa.array(list(agents), pa.string())).to_pylist(),
        "order": steps["order"].to_pylist(),
        "action": _listed(_actions(steps, values)),
        "cumulative_reward": _numbers(steps["cumulative_reward"]),
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
    return _with_nonconforming(columns, steps, values)


def leaf_places(column: Column, array: pa.ChunkedArray, values: PackedValues) -> Places:
    """[rows] the places of one leaf's values; `NONE` where it is null."""
    if column.leaf.kind in ("int", "text", "json"):
        read = plain_of_text if column.leaf.kind == "json" else rounded
        return _coded(array, lambda value: values.place(read(value)))
    raw = cells_of(column, array)
    places = np.full(len(array), NONE)
    if not isinstance(raw, Raw) or not raw.valid.any():  # texts are done above
        return places
    size = raw.values.shape[1]
    if not size:
        places[raw.valid] = values.place([])
        return places
    # Equal values are equal bytes: each is read as an array once, however many rows have it.
    rows = np.ascontiguousarray(raw.values[raw.valid]).view(f"V{size}")[:, 0]
    unique, inverse = np.unique(rows, return_inverse=True)
    dtype, shape = np.dtype(column.leaf.dtype), column.leaf.shape
    found = [
        values.place(plain_array(np.frombuffer(each.tobytes(), dtype).reshape(shape)))
        for each in unique
    ]
    places[raw.valid] = np.array(found)[inverse]
    return places


def _actions(steps: pa.Table, values: PackedValues) -> Places:
    """Places of actions; an action of several leaves is an object by path."""
    columns = value_columns(steps.schema, "action")
    count = steps.num_rows
    if not columns:
        return np.full(count, NONE)
    if len(columns) == 1 and not columns[0].leaf.path:
        return leaf_places(columns[0], steps[columns[0].name], values)
    # Agents with different spaces have different columns: each row joins those that it fills.
    leaves = PackedValues()
    parts = np.stack([leaf_places(each, steps[each.name], leaves) for each in columns], axis=1)
    unique, inverse = np.unique(parts, axis=0, return_inverse=True)
    found = [_joined(row, columns, leaves, values) for row in unique.tolist()]
    return np.array(found, np.int64)[inverse.reshape(-1)]


def _joined(
    row: Sequence[int], columns: Sequence[Column], leaves: PackedValues, values: PackedValues
) -> int:
    held = {
        column.leaf.path: leaves.items[place]
        for column, place in zip(columns, row, strict=True)
        if place != NONE
    }
    if not held:
        return NONE
    return values.place(held[""] if list(held) == [""] else held)


def _masks(steps: pa.Table, values: PackedValues) -> Places:
    """Places of masks: those in infos, else those in observations."""
    masks = steps["action_mask"]
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
    """Type and shape in an info of the mask that was taken out of it: `int8 5`."""
    described = fields_of_text(info).get(MASK)
    return described if isinstance(described, str) else ""


def _mask(mask: bytes, described: str) -> Any:
    dtype, _, shape = described.partition(" ")
    try:
        array = np.frombuffer(mask, dtype or "uint8")
        return plain_array(array.reshape([int(n) for n in shape.split("x") if n] or -1))
    except (TypeError, ValueError):
        return plain_array(np.frombuffer(mask, np.uint8))


def _infos(steps: pa.Table, values: PackedValues) -> Places:
    """Places of infos; empty ones aren't shown, and a mask stands in its own column."""

    def place(text: str) -> int:
        value = plain_of_text(text, without=(MASK,))
        return NONE if value == {} else values.put(value, text)  # every text comes once

    return _coded(steps["info"], place)


def _coded(array: pa.ChunkedArray, place: Any) -> Places:
    """[rows] a place for each row, computed once for every distinct value."""
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
    """Numbers with the digits that are shown, whole ones without a point; null if not finite."""
    unique, inverse = np.unique(array.to_numpy(), return_inverse=True)  # a null is NaN here
    spelled = [_number(value) for value in unique.tolist()]
    return [spelled[place] for place in inverse.tolist()]


def _number(value: float) -> float | int | None:
    if not np.isfinite(value):
        return None
    short = float(f"{value:.{DIGITS + 2}g}")
    return int(short) if short.is_integer() and abs(short) < 2**53 else short


def _with_nonconforming(
    columns: dict[str, Any], steps: pa.Table, values: PackedValues
) -> dict[str, Any]:
    """Adds values that weren't as declared, with field and type, and numbers that aren't finite."""
    found = {
        row: _nonconforming_fields(text)
        for row, text in enumerate(steps["nonconforming"].to_pylist())
        if text is not None
    }
    for name in ("cumulative_reward", "reward"):
        finite = pc.is_finite(steps[name]).fill_null(True)
        for row in np.flatnonzero(~finite.to_numpy(zero_copy_only=False)).tolist():
            found.setdefault(row, {})[name] = str(steps[name][row].as_py())
    nonconforming: list[int | None] = [None] * steps.num_rows
    for row, fields in found.items():
        nonconforming[row] = values.place(fields)
        for name in ("action", "info"):
            if name in fields and columns[name][row] is None:
                columns[name][row] = values.place(fields[name])
    return {**columns, "nonconforming": nonconforming}


def _nonconforming_fields(text: str) -> dict[str, Any]:
    fields = plain_of_text(text)
    if not isinstance(fields, Mapping):
        return {"row": fields}
    return {
        name: f"{entry.get('type')}: {json.dumps(entry.get('value'))}"
        if isinstance(entry, Mapping)
        else entry
        for name, entry in fields.items()
    }
