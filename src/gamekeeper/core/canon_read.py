"""Canonical JSON back into values: no code is run, nothing is imported by a name from the text."""

from __future__ import annotations

import json
import math
import re
from base64 import b64decode
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium.spaces import GraphInstance

from gamekeeper.core.canon_array import SCALARS, number, read_array, read_record, read_scalar
from gamekeeper.errors import EvidenceError

_NESTING: Final = 512  # brackets; `to_json` writes at most 64 containers of at most four brackets
_TOKEN: Final = re.compile(r'"(?:[^"\\]|\\.)*"|[\[\]{}]', re.DOTALL)


@dataclass(frozen=True, slots=True)
class Opaque:
    """A value that only its own code can build: the name of its type, and its repr or its content.

    Args:
        type: "module.Class".
        repr: without addresses, at most 200 characters; "" where the content stands.
        content: canonical JSON of what it held (fields, elements, the plain part of a subclass of a builtin).
    """

    type: str
    repr: str = ""
    content: str | None = None


def from_json(text: str) -> object:
    """The value that a canonical text was written from.

    Builtins and numpy come back equal and of the same types (`np.bool_`, `np.int64`, `np.float64`, `np.str_` as bool,
    int, float, str; byte order little-endian); everything else as an `Opaque`.

    Raises:
        EvidenceError: the text isn't JSON, is nested too deeply, or has an object that `to_json` doesn't write.
    """
    try:
        if text.count("[") + text.count("{") > _NESTING and _nesting(text) > _NESTING:
            raise ValueError(f"nested deeper than {_NESTING}")
        return _DECODER.decode(text)
    except EvidenceError:
        raise
    except (
        ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError, RecursionError, MemoryError
    ) as error:  # fmt: skip
        shown = text if isinstance(text, str) else repr(text)
        raise EvidenceError(
            "a value's JSON can't be read",
            expected="canonical JSON as gamekeeper writes it",
            seen=f"{shown[:80]!r}: {type(error).__name__}: {error}",
            mend="the text was cut or changed; take it from the recording again",
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


def _read(fields: dict[str, Any]) -> object:
    """The value of one JSON object; what is within it has been read already."""
    if "$" not in fields:
        return fields
    kind = fields["$"]
    if kind in SCALARS:
        return read_scalar(kind, fields["v"])
    return _KINDS[kind](fields)


def _opaque(fields: dict[str, Any]) -> Opaque:
    from gamekeeper.core.canon import to_json  # the two directions need each other here only

    name, shown = fields["type"], fields.get("repr", "")
    if not isinstance(name, str) or not isinstance(shown, str):
        raise TypeError("type and repr are text")
    return Opaque(name, shown, to_json(fields["v"]) if "v" in fields else None)


def _scalar(fields: dict[str, Any]) -> np.generic:
    array = fields["v"]
    if not isinstance(array, np.ndarray) or array.shape != ():
        raise ValueError("a scalar is an array of no dimensions")
    scalar: np.generic = array[()]
    return scalar


def _bytes(fields: dict[str, Any]) -> bytes:
    return b64decode(fields["v"], validate=True)


_KINDS: Final[dict[str, Callable[[dict[str, Any]], object]]] = {
    "nan": lambda fields: math.nan,
    "inf": lambda fields: math.inf,
    "-inf": lambda fields: -math.inf,
    "int": lambda fields: int(fields["v"], 16),
    "str": lambda fields: _bytes(fields).decode("utf-8", "surrogatepass"),
    "tuple": lambda fields: tuple(fields["v"]),
    "set": lambda fields: set(fields["v"]),
    "frozenset": lambda fields: frozenset(fields["v"]),
    "dict": lambda fields: dict(fields["v"]),
    "bytes": _bytes,
    "bytearray": lambda fields: bytearray(_bytes(fields)),
    "bytes_": lambda fields: np.bytes_(_bytes(fields)),
    "complex": lambda fields: complex(number(fields["v"][0]), number(fields["v"][1])),
    "range": lambda fields: range(*fields["v"]),
    "scalar": _scalar,
    "ndarray": lambda fields: read_array(fields["dtype"], fields["shape"], fields["v"]),
    "record": lambda fields: read_record(fields["shape"], fields["v"]),
    "GraphInstance": lambda fields: GraphInstance(*fields["v"]),
    "object": _opaque,
}


def _refuse(word: str) -> object:
    raise ValueError(f"{word} isn't JSON")


_DECODER: Final = json.JSONDecoder(object_hook=_read, parse_constant=_refuse)
