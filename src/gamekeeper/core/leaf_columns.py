"""Columns that hold leaves of spaces, found by what a schema says of them."""

from __future__ import annotations

import json
from math import prod
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.core.layout import Column
from gamekeeper.core.space import Leaf
from gamekeeper.errors import EvidenceError

_KINDS: Final = ("list", "bytes", "int", "text", "json")
_MOST: Final = 2**31
"""Elements of a value; more than memory holds, and still far from what overflows."""


def value_columns(schema: pa.Schema, kind: str) -> list[Column]:
    """The columns of `schema` that hold leaves of `kind` ("obs" or "action").

    Raises:
        EvidenceError: what a column says of itself can't be, or doesn't fit its type.
    """
    found = leaf_columns(schema)
    return [column for column in found if column.tag == kind or column.tag.startswith(f"{kind}.")]


def leaf_columns(schema: pa.Schema) -> list[Column]:
    """The columns of `schema` that hold leaves of any space.

    Raises:
        EvidenceError: what a column says of itself can't be, or doesn't fit its type.
    """
    return [_column(field) for field in schema if field.metadata and b"leaf" in field.metadata]


def length_of(leaf: Leaf) -> int:
    """How many elements a value of this leaf has."""
    return prod(leaf.shape)


def _column(field: pa.Field) -> Column:
    try:
        told = json.loads(field.metadata[b"leaf"])
        leaf = Leaf(told["path"], told["kind"], told["dtype"], tuple(told["shape"]))
        column = Column(field.name, field.metadata[b"tag"].decode(), leaf)
        fits = _fits(leaf, field.type)
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise _damaged(field, f"{type(error).__name__}: {error}") from None
    if not fits:
        raise _damaged(field, f"{field.type}, and {field.metadata[b'leaf']!r}")
    return column


def _fits(leaf: Leaf, kind: pa.DataType) -> bool:
    """Whether a column of this type can hold such a leaf."""
    if not isinstance(leaf.path, str) or leaf.kind not in _KINDS:
        return False
    if leaf.kind in ("text", "json"):
        return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))
    if leaf.kind == "int":
        return bool(pa.types.is_int64(kind))
    if any(type(length) is not int or length < 0 for length in leaf.shape):
        return False
    dtype: np.dtype[Any] = np.dtype(leaf.dtype)
    if dtype.hasobject or length_of(leaf) > _MOST:
        return False
    if leaf.kind == "bytes" or not length_of(leaf):
        return bool(pa.types.is_binary(kind) or pa.types.is_large_binary(kind))
    return bool(
        pa.types.is_fixed_size_list(kind)
        and kind.list_size == length_of(leaf)
        and kind.value_type.to_pandas_dtype() == dtype.type
    )


def _damaged(field: pa.Field, seen: str) -> EvidenceError:
    return EvidenceError(
        "a column of values says something of itself that can't be",
        where=field.name,
        expected="path, kind, dtype and shape of a leaf, as its type has them",
        seen=seen[:300],
        mend="restore the bundle from a copy, or record the run again",
    )
