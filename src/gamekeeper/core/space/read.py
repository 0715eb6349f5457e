"""Spaces out of the JSON that `plain` writes; sizes are bounded before they are allocated."""

from __future__ import annotations

import math
import reprlib
from base64 import b64decode
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import (
    Box,
    Dict,
    Discrete,
    Graph,
    MultiBinary,
    MultiDiscrete,
    OneOf,
    Sequence,
    Space,
    Text,
    Tuple,
)

from gamekeeper.core.canon.array import long_double
from gamekeeper.core.canon.read import from_json
from gamekeeper.errors import EvidenceError

Array = npt.NDArray[Any]
Json = Mapping[str, Any]

_ELEMENTS: Final = 2**28  # in all arrays of one space: a short JSON must not ask for all memory
_DEPTH: Final = 64
_WORDS: Final = {"inf": math.inf, "-inf": -math.inf}


class UnknownSpace(Space[Any]):
    """Stands for a space whose class only its own code knows; equal where class and repr are.

    Args:
        class_name: "module.Class".
        shown: its repr, without addresses.
    """

    def __init__(self, class_name: str, shown: str) -> None:
        super().__init__()
        self.class_name = class_name
        self.shown = shown

    def contains(self, x: Any) -> bool:
        """Never knows."""
        raise NotImplementedError(f"only {self.class_name} knows its values")

    def sample(self, mask: Any = None, probability: Any = None) -> Any:
        """Never can."""
        raise NotImplementedError(f"only {self.class_name} samples its values")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, UnknownSpace) and repr(self) == repr(other)

    def __hash__(self) -> int:
        return hash(repr(self))

    def __repr__(self) -> str:
        return f"UnknownSpace({self.class_name!r}, {self.shown!r})"


def space_from_json(described: Json) -> Space[Any]:
    """The space that this JSON describes.

    Raises:
        EvidenceError: it describes none, or one whose arrays have more than 2**28 elements in all.
    """
    try:
        with np.errstate(over="raise"):
            return _Reader().space(described)
    except EvidenceError:
        raise
    except (ArithmeticError, AssertionError, AttributeError, LookupError, MemoryError, TypeError,
            ValueError) as error:  # fmt: skip
        raise EvidenceError(
            "a space's JSON can't be read",
            expected="a space as gamekeeper writes it",
            seen=f"{reprlib.repr(described)}: {type(error).__name__}: {error}",
            mend="the file was changed, or comes from a newer version",
        ) from error


class _Reader:
    """Builds one space, and counts how deep it is and how much its arrays hold."""

    __slots__ = ("depth", "elements")

    def __init__(self) -> None:
        self.depth = self.elements = 0

    def space(self, described: Json) -> Space[Any]:
        self.depth += 1
        if self.depth > _DEPTH:
            raise ValueError(f"spaces nested deeper than {_DEPTH}")
        built = _KINDS[described["kind"]](self, described)
        self.depth -= 1
        return built

    def spaces(self, described: Json) -> list[Space[Any]]:
        return [self.space(inner) for inner in described["spaces"]]

    def count(self, shape: tuple[int, ...]) -> int:
        """How many elements an array has that is going to be built."""
        count = math.prod(shape)
        self.elements += count
        if self.elements > _ELEMENTS:
            raise ValueError(f"more than {_ELEMENTS} elements")
        return count

    def array(self, values: Any, dtype: np.dtype[Any], shape: tuple[int, ...]) -> Array:
        """[shape] what `plain` wrote of an array."""
        count = self.count(shape)
        if isinstance(values, Mapping):
            data = b64decode(values["base64"], validate=True)
            if len(data) != count * dtype.itemsize:
                raise ValueError(f"{len(data)} bytes for {count} elements of {dtype}")
            return np.frombuffer(data, dtype.newbyteorder("<")).astype(dtype).reshape(shape)
        if not isinstance(values, list):
            return np.full(shape, _number(values, dtype), dtype)
        if len(values) != count:
            raise ValueError(f"{len(values)} values for {count} elements")
        return np.array([_number(value, dtype) for value in values], dtype).reshape(shape)


def _number(value: Any, dtype: np.dtype[Any]) -> Any:
    if dtype.kind == "f":
        if dtype.itemsize > 8:
            return long_double(value)
        value = _WORDS[value] if isinstance(value, str) else value
    fits = {"b": (bool,), "f": (int, float)}.get(dtype.kind, (int,))
    if type(value) not in fits:
        raise TypeError(f"{value!r} isn't of {dtype}")
    return dtype.type(value)  # which raises where it is too large; an array may wrap it around


def _whole(value: Any) -> int:
    if type(value) is not int:
        raise TypeError(f"{value!r} isn't a whole number")
    return value


def _shape(described: Json) -> tuple[int, ...]:
    shape = tuple(map(_whole, described["shape"]))
    if any(side < 0 for side in shape) or len(shape) > 32:
        raise ValueError(f"no shape: {shape}")
    return shape


def _dtype(described: Json) -> np.dtype[Any]:
    name = described["dtype"]
    if not isinstance(name, str) or name[:1] not in "<>|=" or not name[2:].isdecimal():
        raise ValueError(f"no dtype: {name!r}")
    dtype = np.dtype(name)
    if dtype.kind not in "biuf":
        raise ValueError(f"no dtype of a space: {name!r}")
    return dtype


def _box(reader: _Reader, described: Json) -> Box:
    dtype, shape = _dtype(described), _shape(described)
    low = reader.array(described["low"], dtype, shape)
    high = reader.array(described["high"], dtype, shape)
    # Box asks whether its bounds are infinite, which numpy doesn't answer for bools.
    given = np.dtype(np.uint8) if dtype.kind == "b" else dtype
    box = Box(low.astype(given), high.astype(given), shape, dtype)
    for name in ("bounded_below", "bounded_above"):
        if name in described:
            setattr(box, name, reader.array(described[name], np.dtype(np.bool_), shape))
    return box


def _multi_discrete(reader: _Reader, described: Json) -> MultiDiscrete[Any]:
    dtype, shape = _dtype(described), _shape(described)
    nvec = reader.array(described["nvec"], dtype, shape)
    start = reader.array(described["start"], dtype, shape)
    return MultiDiscrete(nvec, dtype, start=start)


def _multi_binary(reader: _Reader, described: Json) -> MultiBinary:
    n = described["n"]
    shape = _shape({"shape": n if isinstance(n, list) else [n]})
    reader.count(shape)
    return MultiBinary(shape if isinstance(n, list) else n)


def _text(reader: _Reader, described: Json) -> Text:
    charset = described["charset"]
    # A list of numbers where characters might melt into others on their way through JSON.
    text = charset if isinstance(charset, str) else "".join(map(chr, charset))
    return Text(_whole(described["max"]), min_length=_whole(described["min"]), charset=text)


def _dict(reader: _Reader, described: Json) -> Dict:
    pairs: list[tuple[Any, Space[Any]]] = [
        (key if isinstance(key, str) else from_json(key["json"]), reader.space(inner))
        for key, inner in described["spaces"]
    ]
    options: dict[str, Any] = {} if described.get("sort_keys", True) else {"sort_keys": False}
    return Dict(pairs, **options)  # a list of pairs keeps its order either way


def _discrete(reader: _Reader, described: Json) -> Discrete[Any]:
    dtype = _dtype(described)
    n, start = _whole(described["n"]), _whole(described["start"])
    if dtype == np.int64:  # Gymnasium 1.1 knows no other
        return Discrete(n, start=start)
    return Discrete(n, start=start, dtype=dtype)


def _graph(reader: _Reader, described: Json) -> Graph:
    edge = described["edge"]
    return Graph(reader.space(described["node"]), None if edge is None else reader.space(edge))


_KINDS: Final[dict[str, Callable[[_Reader, Json], Space[Any]]]] = {
    "Box": _box,
    "Discrete": _discrete,
    "MultiDiscrete": _multi_discrete,
    "MultiBinary": _multi_binary,
    "Text": _text,
    "Dict": _dict,
    "Tuple": lambda reader, described: Tuple(reader.spaces(described)),
    "OneOf": lambda reader, described: OneOf(reader.spaces(described)),
    "Sequence": lambda reader, described: Sequence(
        reader.space(described["space"]), stack=bool(described["stack"])
    ),
    "Graph": _graph,
    "unknown": lambda reader, described: UnknownSpace(
        str(described["class"]), str(described["repr"])
    ),
}
