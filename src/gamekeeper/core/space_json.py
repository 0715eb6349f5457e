"""Gymnasium spaces as plain JSON, and back: exact bounds, no pickle, no import by name.

A space is `{"kind": "Box", ...}` with the arguments that build it again. Bounds that are the same everywhere stand once;
infinite ones are "inf" and "-inf". A subclass of a known space is written as that space, with its own "class" beside it,
and comes back as the known one. A class that we don't know is `{"kind": "unknown", "class": ..., "repr": ...}` and comes
back as an `UnknownSpace`.
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
from gamekeeper.core.space_read import UnknownSpace, space_from_json

Array = npt.NDArray[Any]
Json = dict[str, Any]

__all__ = ["UnknownSpace", "space_from_json", "space_to_json"]

_LISTED: Final = 256  # elements


def space_to_json(space: Space[Any]) -> Json:
    """The space as plain JSON with sorted keys; equal for equal spaces whose keys come in one order."""
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
    # An int Box with an infinite bound has the dtype's own limit for it, and remembers that it is none.
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
    characters = list(space.character_list)  # in the order in which they are drawn
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
    if not getattr(space, "sort_keys", True):
        described["sort_keys"] = False
    return described


def _values(array: Array) -> Any:
    """One value where all are the same; a flat list up to 256 elements; base64 of little-endian C bytes beyond."""
    flat = np.ascontiguousarray(array).reshape(-1)
    if flat.size and flat.tobytes() == flat[:1].tobytes() * flat.size:
        return _value(flat[0])
    if flat.size <= _LISTED or flat.dtype.itemsize > 8:
        return [_value(item) for item in flat]
    return {"base64": b64encode(flat.astype(flat.dtype.newbyteorder("<")).tobytes()).decode()}


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
        "dtype": space.dtype.str,
        "n": int(space.n),
        "start": int(space.start),
    },
    MultiDiscrete: _multi_discrete,
    MultiBinary: lambda space: {"n": space.n if isinstance(space.n, int) else list(space.n)},
    Text: _text,
    Dict: _dict,
    Tuple: lambda space: {"spaces": [space_to_json(inner) for inner in space.spaces]},
    OneOf: lambda space: {"spaces": [space_to_json(inner) for inner in space.spaces]},
    Sequence: lambda space: {"space": space_to_json(space.feature_space), "stack": space.stack},
    Graph: lambda space: {
        "node": space_to_json(space.node_space),
        "edge": None if space.edge_space is None else space_to_json(space.edge_space),
    },
}
