"""Gymnasium spaces as plain JSON: exact bounds, no pickle, keys sorted, so that it can be hashed.

A space is `{"kind": "Box", ...}` with what builds it again. Bounds that are the same everywhere
stand once, infinite ones are "inf" and "-inf". A subclass of a known space is written as that space
with its own "class" beside it, and comes back as the known one. A class that we don't know is
`{"kind": "unknown", "class": ..., "repr": ...}` and comes back as an `UnknownSpace`.
"""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Callable
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

from gamekeeper.core.canon import shown, to_json, type_name
from gamekeeper.core.space.read import UnknownSpace, space_from_json

__all__ = ["UnknownSpace", "space_from_json", "space_to_json"]

Array = npt.NDArray[Any]
Json = dict[str, Any]

_LISTED: Final = 256  # elements


def space_to_json(space: Space[Any]) -> Json:
    """The space as plain JSON, equal for equal spaces whose Dict keys stand in one order."""
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
            [key if isinstance(key, str) else {"json": to_json(key)}, space_to_json(inner)]
            for key, inner in space.spaces.items()
        ]
    }
    if not getattr(space, "sort_keys", True):  # new in Gymnasium 1.4
        described["sort_keys"] = False
    return described


def _inner(space: Any) -> Json:
    return {"spaces": [space_to_json(inner) for inner in space.spaces]}


def _graph(space: Graph) -> Json:
    edge = space.edge_space
    return {
        "node": space_to_json(space.node_space),
        "edge": None if edge is None else space_to_json(edge),
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
    Sequence: lambda space: {"space": space_to_json(space.feature_space), "stack": space.stack},
    Graph: _graph,
}
