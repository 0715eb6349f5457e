"""Canonical JSON back into values: no code is run, and no name from a text is imported."""

from __future__ import annotations

import json
import math
import re
from base64 import b64decode
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from gymnasium.spaces import GraphInstance

from gamekeeper.core.canon.array import SCALARS, number, read_array, read_record, read_scalar
from gamekeeper.core.canon.object import Opaque
from gamekeeper.core.canon.write import to_json
from gamekeeper.errors import EvidenceError

_NESTING: Final = 512  # brackets; `to_json` nests 64 containers of at most four
_TOKEN: Final = re.compile(r'"(?:[^"\\]|\\.)*"|[\[\]{}]', re.DOTALL)

Fields = dict[str, Any]


def from_json(text: str) -> object:
    """The value that a canonical text was written from.

    Builtins and numpy come back equal and of the same types (`np.bool_`, `np.int64`, `np.float64`
    and `np.str_` as bool, int, float and str), all else as an `Opaque`.

    Raises:
        EvidenceError: the text isn't JSON, is nested too deeply, or has an object that `to_json`
            doesn't write.
    """
    try:
        if text.count("[") + text.count("{") > _NESTING and _nesting(text) > _NESTING:
            raise ValueError(f"nested deeper than {_NESTING}")
        return _DECODER.decode(text)
    except EvidenceError:
        raise
    except (ArithmeticError, AttributeError, LookupError, MemoryError, RecursionError, TypeError,
            ValueError) as error:  # fmt: skip
        raise EvidenceError(
            "a value's JSON can't be read",
            expected="canonical JSON as gamekeeper writes it",
            seen=f"{str(text)[:80]!r}: {type(error).__name__}: {error}",
            mend="the text was cut or changed: take it from the recording again",
        ) from error


def _nesting(text: str) -> int:
    """The deepest nesting of brackets outside strings."""
    depth = deepest = 0
    for token in _TOKEN.finditer(text):
        first = text[token.start()]
        if first in "[{":
            depth += 1
            deepest = max(deepest, depth)
        elif first != '"':
            depth -= 1
    return deepest


def _read(fields: Fields) -> object:
    """The value of one JSON object; what is within it has been read already."""
    if "$" not in fields:
        return fields
    kind = fields["$"]
    if kind in SCALARS:
        return read_scalar(kind, fields["v"])
    return _KINDS[kind](fields)


def _opaque(fields: Fields) -> Opaque:
    name, words = fields["type"], fields.get("repr", "")
    if not isinstance(name, str) or not isinstance(words, str):
        raise TypeError("type and repr are text")
    return Opaque(name, words, to_json(fields["v"]) if "v" in fields else None)


def _scalar(fields: Fields) -> object:
    array = fields["v"]
    if not isinstance(array, np.ndarray) or array.shape != ():
        raise TypeError("a scalar is an array of no dimensions")
    return array[()]


def _bytes(fields: Fields) -> bytes:
    return b64decode(fields["v"], validate=True)


def _items(fields: Fields) -> list[Any]:
    items = fields["v"]
    if type(items) is not list:
        raise TypeError("elements stand in a list")
    return items


def _refuse(word: str) -> object:
    raise ValueError(f"{word} isn't JSON")


_KINDS: Final[dict[str, Callable[[Fields], object]]] = {
    "nan": lambda fields: math.nan,
    "inf": lambda fields: math.inf,
    "-inf": lambda fields: -math.inf,
    "int": lambda fields: int(fields["v"], 16),
    "str": lambda fields: _bytes(fields).decode("utf-8", "surrogatepass"),
    "tuple": lambda fields: tuple(_items(fields)),
    "set": lambda fields: set(_items(fields)),
    "frozenset": lambda fields: frozenset(_items(fields)),
    "dict": lambda fields: dict(_items(fields)),
    "bytes": _bytes,
    "bytearray": lambda fields: bytearray(_bytes(fields)),
    "bytes_": lambda fields: np.bytes_(_bytes(fields)),
    "complex": lambda fields: complex(*map(number, _items(fields))),
    "range": lambda fields: range(*_items(fields)),
    "scalar": _scalar,
    "ndarray": lambda fields: read_array(fields["dtype"], fields["shape"], fields["v"]),
    "record": lambda fields: read_record(fields["shape"], _items(fields)),
    "GraphInstance": lambda fields: GraphInstance(*_items(fields)),
    "object": _opaque,
}

_DECODER: Final = json.JSONDecoder(object_hook=_read, parse_constant=_refuse)
