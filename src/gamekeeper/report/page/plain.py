"""Recorded values as plain JSON that a reader understands, bounded in size."""

from __future__ import annotations

import json
import math
from base64 import b64decode
from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np

MOST_CHARACTERS: Final = 2_000
"""Of one value on the page; the run has all of it."""
MOST_ELEMENTS: Final = 512
DEEPEST: Final = 32
DIGITS: Final = 7
"""Significant digits of a number on the page: what a 32-bit float has."""


class Values:
    """Plain values, each kept once; who shows one names its place."""

    def __init__(self) -> None:
        """None yet."""
        self.items: list[Any] = []
        self._places: dict[str, int] = {}

    def place(self, value: Any) -> int:
        """The place of a plain value."""
        text = json.dumps(value, sort_keys=True)
        known = self._places.get(text)
        if known is None:
            known = self._places[text] = self.put(value, text)
        return known

    def put(self, value: Any, text: str) -> int:
        """The place of a value that is known to be new; cut where its text is long."""
        if len(text) > MOST_CHARACTERS:
            text = json.dumps(value)
            if len(text) > MOST_CHARACTERS:
                value = f"{text[:MOST_CHARACTERS]}… ({len(text):,} characters)"
        self.items.append(value)
        return len(self.items) - 1


def plain_of_text(text: str, *, without: Iterable[str] = ()) -> Any:
    """A canonical JSON text as plain JSON; as it stands where it can't be read.

    Args:
        text: as `core.canon.to_json` writes it.
        without: fields that are shown elsewhere.
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


def plain_array(array: Any) -> Any:
    """An array as nested lists; a number where it has no dimensions; in words where it is large."""
    if array.size > MOST_ELEMENTS:
        return f"array {array.dtype} {list(array.shape)}"
    return rounded(array.tolist())


def rounded(value: Any) -> Any:
    """The same with as many digits as a page shows; what JSON lacks (NaN, infinity) as text."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else _odd_number(value)
    if isinstance(value, list):
        return [rounded(item) for item in value]
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if isinstance(value, complex):
        return str(value)
    return value


def _odd_number(value: float) -> str:
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
    """What plain JSON doesn't know, as close as it comes."""
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
