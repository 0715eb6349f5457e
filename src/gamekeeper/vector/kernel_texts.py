"""Infos of many rows as canonical JSON, column by column.

What `gamekeeper.core.canon.to_json` writes of each info alone, without a look at single rows.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gamekeeper.core.canon import to_json

LISTED: Final = 64  # elements: longer arrays are base64
SCALAR_WORDS: Final = ('{"$":"nan"}', '{"$":"inf"}', '{"$":"-inf"}')
LISTED_WORDS: Final = ('"nan"', '"inf"', '"-inf"')


def info_texts(
    records: NDArray[Any] | None,
    masks: pa.Array | None,
    given: NDArray[np.bool_],
    *,
    without: Collection[str] = (),
) -> pa.Array | None:
    """The infos of rows, null where none was given; None where there are no infos at all.

    Args:
        records: [rows] the fields of a kernel's infos; None: it has none.
        masks: [rows] the texts of action masks; None: it has none.
        given: [rows] whether the row has an info.
        without: names of fields that are left out.
    """
    columns: dict[str, Any] = {}
    if records is not None:
        columns = {name: records[name] for name in records.dtype.names or ()}
    if masks is not None:
        columns["action_mask"] = masks
    if not columns:
        return None
    pieces: list[Any] = []
    prefix = "{"
    for name in sorted(columns):
        if name not in without:
            column = columns[name]
            values = column if isinstance(column, pa.Array) else field_texts(column)
            pieces += [f"{prefix}{to_json(name)}:", values]
            prefix = ","
    if not pieces:
        return pc.if_else(pa.array(given), "{}", pa.scalar(None, pa.string()))
    text = pc.binary_join_element_wise(*pieces, "}", "")
    return text if given.all() else pc.if_else(pa.array(given), text, pa.scalar(None, pa.string()))


def field_texts(values: NDArray[Any]) -> pa.Array:
    """The texts of one field, [rows] or [rows, ...]."""
    if values.ndim == 1:
        return number_texts(values, SCALAR_WORDS)
    rows, shape = len(values), values.shape[1:]
    count = int(np.prod(shape))
    if count > LISTED or not count or values.dtype.kind not in "biuf":
        return pa.array([to_json(value) for value in values], pa.string())
    head, _, tail = to_json(np.zeros(shape, values.dtype)).rpartition("[")
    flat = number_texts(np.ascontiguousarray(values).reshape(-1), LISTED_WORDS)
    offsets = pa.array(np.arange(rows + 1, dtype=np.int32) * count)
    joined = pc.binary_join(pa.ListArray.from_arrays(offsets, flat), ",")
    return pc.binary_join_element_wise(f"{head}[", joined, tail[tail.index("]") :], "")


def number_texts(values: NDArray[Any], words: tuple[str, str, str]) -> pa.Array:
    """Numbers as JSON has them, [values]; `words` for NaN and the infinities."""
    if values.dtype.kind == "b":
        return pc.if_else(pa.array(values), "true", "false")
    if values.dtype.kind in "iu":
        return pc.cast(pa.array(np.ascontiguousarray(values)), pa.string())
    wide = values.astype(np.float64)
    texts = pa.array(repr(wide.tolist())[1:-1].split(", ") if len(wide) else [], pa.string())
    if np.isfinite(wide).all():
        return texts
    for word, mask in zip(words, (np.isnan(wide), wide == np.inf, wide == -np.inf), strict=True):
        texts = pc.if_else(pa.array(mask), word, texts)
    return texts


def mask_texts(flags: NDArray[np.int8], parts: tuple[int, ...] | None) -> pa.Array:
    """What stands of action masks in infos, [rows].

    Args:
        flags: [rows, actions].
        parts: how many of each part of a MultiDiscrete; None: of a Discrete, whose mask has a
            column of its own.
    """
    if parts is None:
        text = to_json(f"|i1 {flags.shape[1]}")
        return pa.array([text], pa.string()).take(pa.array(np.zeros(len(flags), np.int32)))
    bits = np.ascontiguousarray(flags).view(f"V{flags.shape[1]}")[:, 0]
    distinct, codes = np.unique(bits, return_inverse=True)
    cuts = np.cumsum(parts)[:-1]
    rows = distinct.view(np.int8).reshape(len(distinct), flags.shape[1])
    texts = [to_json(tuple(np.split(row, cuts))) for row in rows]
    return pa.array(texts, pa.string()).take(pa.array(codes.reshape(-1)))
