"""Gymnasium spaces as plain JSON: exact bounds, no pickle, keys sorted, so that it can be hashed.

A space is `{"kind": "Box", ...}` with what builds it again. Bounds that are the same everywhere
stand once, infinite ones are "inf" and "-inf". A subclass of a known space is written as that space
with its own "class" beside it, and comes back as the known one. A class that we don't know is
`{"kind": "unknown", "class": ..., "repr": ...}` and comes back as an `UnknownSpace`.
"""

from __future__ import annotations  # `MultiDiscrete[Any]` is an error with Gymnasium 1.2

import math
import reprlib
from base64 import b64decode, b64encode
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
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

from gamekeeper.episodes.canonical import from_json, shown, to_json, type_name
from gamekeeper.episodes.canonical.arrays import Array, long_double
from gamekeeper.episodes.plain_json import is_damage, is_misshapen
from gamekeeper.episodes.spaces.nesting import MOST_DEEP, check_extent
from gamekeeper.errors import EvidenceError

Json = dict[str, Any]
_ELEMENTS: Final = 2**28  # in all arrays of one space: a short JSON must not ask for all memory
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
        """True of every value: only the class knows which ones aren't of it."""
        return True

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
            return _SpaceReader().space(described)
    except EvidenceError:
        raise
    except Exception as error:
        # Gymnasium asserts what its spaces are made of.
        if not (is_damage(error) or is_misshapen(error) or isinstance(error, AssertionError)):
            raise
        raise EvidenceError(
            "a space's JSON can't be read",
            expected="a space as gamekeeper writes it",
            actual=f"{reprlib.repr(described)}: {type(error).__name__}: {error}",
            fix="the file was changed, or comes from a newer version",
        ) from error


class _SpaceReader:
    """Builds one space, and counts how deep it is and how much its arrays hold."""

    __slots__ = ("depth", "elements")

    def __init__(self) -> None:
        self.depth = self.elements = 0

    def space(self, described: Json) -> Space[Any]:
        self.depth += 1
        if self.depth > MOST_DEEP:
            raise ValueError(f"spaces nested deeper than {MOST_DEEP}")
        built = _KINDS[described["kind"]](self, described)
        self.depth -= 1
        return built

    def spaces(self, described: Json) -> list[Space[Any]]:
        return [self.space(inner) for inner in described["spaces"]]

    def count(self, shape: tuple[int, ...]) -> int:
        """Counts the elements of an array that is going to be built."""
        count = math.prod(shape)
        self.elements += count
        if self.elements > _ELEMENTS:
            raise ValueError(f"more than {_ELEMENTS} elements")
        return count

    def array(self, values: Any, dtype: np.dtype[Any], shape: tuple[int, ...]) -> Array:
        """[shape] the array that `_values` wrote."""
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


def _read_box(reader: _SpaceReader, described: Json) -> Box:
    dtype, shape = _dtype(described), _shape(described)
    low, high = (reader.array(described[name], dtype, shape) for name in ("low", "high"))
    # Box asks whether its bounds are infinite, which numpy doesn't answer for bools.
    given = np.dtype(np.uint8) if dtype.kind == "b" else dtype
    box = Box(low.astype(given), high.astype(given), shape, dtype)
    for name in ("bounded_below", "bounded_above"):
        if name in described:
            setattr(box, name, reader.array(described[name], np.dtype(np.bool_), shape))
    return box


def _read_multi_discrete(reader: _SpaceReader, described: Json) -> MultiDiscrete[Any]:
    dtype, shape = _dtype(described), _shape(described)
    nvec, start = (reader.array(described[name], dtype, shape) for name in ("nvec", "start"))
    return MultiDiscrete(nvec, dtype, start=start)


def _multi_binary(reader: _SpaceReader, described: Json) -> MultiBinary:
    n = described["n"]
    shape = _shape({"shape": n if isinstance(n, list) else [n]})
    reader.count(shape)
    return MultiBinary(shape if isinstance(n, list) else n)


def _read_text(reader: _SpaceReader, described: Json) -> Text:
    charset = described["charset"]
    # A list of numbers where characters might melt into others on their way through JSON.
    text = charset if isinstance(charset, str) else "".join(map(chr, charset))
    return Text(_whole(described["max"]), min_length=_whole(described["min"]), charset=text)


def _read_dict(reader: _SpaceReader, described: Json) -> Dict:
    pairs: list[tuple[Any, Space[Any]]] = [
        (key if isinstance(key, str) else from_json(key["json"]), reader.space(inner))
        for key, inner in described["spaces"]
    ]
    options: dict[str, Any] = {} if described.get("sort_keys", True) else {"sort_keys": False}
    return Dict(pairs, **options)  # a list of pairs keeps its order either way


def _discrete(reader: _SpaceReader, described: Json) -> Discrete[Any]:
    dtype = _dtype(described)
    options: dict[str, Any] = {} if dtype == np.int64 else {"dtype": dtype}  # Gymnasium 1.1 has one
    return Discrete(_whole(described["n"]), start=_whole(described["start"]), **options)


def _read_graph(reader: _SpaceReader, described: Json) -> Graph:
    edge = described["edge"]
    return Graph(reader.space(described["node"]), None if edge is None else reader.space(edge))


_KINDS: Final[dict[str, Callable[[_SpaceReader, Json], Space[Any]]]] = {
    "Box": _read_box,
    "Discrete": _discrete,
    "MultiDiscrete": _read_multi_discrete,
    "MultiBinary": _multi_binary,
    "Text": _read_text,
    "Dict": _read_dict,
    "Tuple": lambda reader, described: Tuple(reader.spaces(described)),
    "OneOf": lambda reader, described: OneOf(reader.spaces(described)),
    "Sequence": lambda reader, described: Sequence(
        reader.space(described["space"]), stack=bool(described["stack"])
    ),
    "Graph": _read_graph,
    "unknown": lambda reader, described: UnknownSpace(
        str(described["class"]), str(described["repr"])
    ),
}


_LISTED: Final = 256  # elements


def space_to_json(space: Space[Any]) -> Json:
    """The space as plain JSON, equal for equal spaces whose Dict keys stand in one order.

    Raises:
        EnvError: the space is nested too deep or has too many parts to be read again.
    """
    check_extent(space)
    return _described(space)


def _described(space: Space[Any]) -> Json:
    if isinstance(space, UnknownSpace):
        return {"class": space.class_name, "kind": "unknown", "repr": space.shown}
    for cls, describe in _WRITERS.items():
        if isinstance(space, cls):
            described = {"kind": cls.__name__, **describe(space)}
            if type(space) is not cls:
                described["class"] = type_name(space)
            return dict(sorted(described.items()))
    return {"class": type_name(space), "kind": "unknown", "repr": shown(space)}


def _box(space: Box) -> Json:
    described: Json = {
        "dtype": space.dtype.str,
        "shape": list(space.shape),
        "low": _values(space.low),
        "high": _values(space.high),
    }
    # A Box of ints holds its dtype's limit where it was given an infinite bound, and a flag for it.
    if not np.array_equal(space.bounded_below, space.low > -np.inf):
        described["bounded_below"] = _values(space.bounded_below)
    if not np.array_equal(space.bounded_above, space.high < np.inf):
        described["bounded_above"] = _values(space.bounded_above)
    return described


def _multi_discrete(space: MultiDiscrete[Any]) -> Json:
    return {
        "dtype": space.dtype.str,
        "shape": list(space.shape),
        "nvec": _values(space.nvec),
        "start": _values(space.start),
    }


def _text(space: Text) -> Json:
    characters = space.character_list  # in the order in which a sample draws them
    text = "".join(characters)
    charset = text if text.isascii() else [ord(character) for character in characters]
    return {"min": space.min_length, "max": space.max_length, "charset": charset}


def _dict(space: Dict) -> Json:
    described: Json = {
        "spaces": [
            [key if isinstance(key, str) else {"json": to_json(key)}, _described(inner)]
            for key, inner in space.spaces.items()
        ]
    }
    if not getattr(space, "sort_keys", True):  # new in Gymnasium 1.4
        described["sort_keys"] = False
    return described


def _inner(space: Any) -> Json:
    return {"spaces": [_described(inner) for inner in space.spaces]}


def _graph(space: Graph) -> Json:
    edge = space.edge_space
    return {
        "node": _described(space.node_space),
        "edge": None if edge is None else _described(edge),
    }


def _values(array: Array) -> Any:
    """One value where all are the same, else a flat list; base64 beyond 256 elements."""
    flat = np.ascontiguousarray(array).reshape(-1)
    if flat.size and flat.tobytes() == flat[:1].tobytes() * flat.size:
        return _value(flat[0])
    if flat.size <= _LISTED or flat.dtype.itemsize > 8:  # the bytes of long doubles have holes
        return [_value(item) for item in flat]
    little = flat.astype(flat.dtype.newbyteorder("<"))
    return {"base64": b64encode(little.tobytes()).decode()}


def _value(item: Any) -> Any:
    if isinstance(item, np.longdouble):
        return str(item)
    plain = item.item()
    if isinstance(plain, float) and not math.isfinite(plain):
        return "inf" if plain > 0 else "-inf"
    return plain


_WRITERS: Final[dict[type[Space[Any]], Callable[[Any], Json]]] = {
    Box: _box,
    Discrete: lambda space: {
        "dtype": np.dtype(space.dtype).str,
        "n": int(space.n),
        "start": int(space.start),
    },
    MultiDiscrete: _multi_discrete,
    MultiBinary: lambda space: {"n": space.n if type(space.n) is int else list(space.n)},
    Text: _text,
    Dict: _dict,
    Tuple: _inner,
    OneOf: _inner,
    Sequence: lambda space: {"space": _described(space.feature_space), "stack": space.stack},
    Graph: _graph,
}
