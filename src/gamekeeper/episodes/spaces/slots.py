"""Slots: the value of each leaf of a space packed into bytes, a number or a text, and back.

A value of a space without a fixed shape is packed as canonical JSON. Structure, dtypes and shapes
must be exact, bounds aren't looked at. A space class that we don't know is asked by its own
`contains`.
"""

import math
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from gymnasium.spaces import (
    Box,
    Dict,
    Discrete,
    Graph,
    GraphInstance,
    MultiBinary,
    MultiDiscrete,
    OneOf,
    Sequence,
    Space,
    Text,
    Tuple,
)

from gamekeeper.episodes.canonical import from_json, is_exact, to_json
from gamekeeper.errors import EvidenceError

# -- Spaces of a single array, number or text

Payload = bytes | int | str
Pack = Callable[[Any], Payload | None]
Unpack = Callable[[Any], object]

_LISTED: Final = 256  # elements: more stand as plain bytes in their column
_INT64: Final = np.iinfo(np.int64)


@dataclass(frozen=True, slots=True)
class Slot:
    """The content of a column for one leaf, and the functions that pack and unpack it.

    Args:
        kind: "list" and "bytes" (C bytes, little-endian), "int", "text" or "json".
        dtype: little-endian, "" for text and json.
        shape: () for all but arrays.
        pack: the payload, or None where the value isn't exactly as declared.
        unpack: the value of a payload; EvidenceError where it can't be one.
    """

    kind: str
    dtype: str
    shape: tuple[int, ...]
    pack: Pack
    unpack: Unpack


def slot(space: Space[Any]) -> Slot | None:
    """The slot of a space that is a single array, number or text; None for all others."""
    if isinstance(space, Discrete):
        return _number(space.dtype)
    if isinstance(space, Text):
        return Slot("text", "", (), _pack_text, _unpack_text)
    if isinstance(space, Box | MultiBinary | MultiDiscrete) and space.dtype.itemsize <= 8:
        return _array(space.dtype, tuple(space.shape))
    return None  # the bytes of a long double have holes


def _array(dtype: np.dtype[Any], shape: tuple[int, ...]) -> Slot:
    little = dtype.newbyteorder("<")
    count = math.prod(shape)
    is_plain = dtype == np.uint8 or dtype == np.bool_ or count > _LISTED or count == 0
    pack, unpack = _pack_array(dtype, shape), _unpack_array(dtype, little, shape)
    if dtype != little:  # declared in an order of bytes that isn't little-endian
        return Slot("bytes" if is_plain else "list", little.str, shape, _swapped(pack), unpack)
    return Slot("bytes" if is_plain else "list", little.str, shape, pack, unpack)


def _pack_array(dtype: np.dtype[Any], shape: tuple[int, ...]) -> Pack:
    array_type, scalar_type = np.ndarray, dtype.type

    def pack(value: Any) -> bytes | None:
        if value.__class__ is array_type and value.shape == shape:
            given = value.dtype
            if given is dtype or given == dtype:  # `==` costs ten times `is`
                data: bytes = value.tobytes()
                return data
        return None

    def pack_scalar(value: Any) -> bytes | None:
        return _little(value) if value.__class__ is scalar_type else pack(value)

    return pack if shape else pack_scalar


def _swapped(pack: Pack) -> Pack:
    return lambda value: None if pack(value) is None else _little(value)


def _little(value: Any) -> bytes:
    """The C bytes of an array or of a scalar of numpy, which is always in the machine's order."""
    is_little = value.dtype == value.dtype.newbyteorder("<")
    return bytes((value if is_little else value.byteswap()).tobytes())


def _unpack_array(dtype: np.dtype[Any], little: np.dtype[Any], shape: tuple[int, ...]) -> Unpack:
    size = math.prod(shape) * dtype.itemsize

    def unpack(payload: Any) -> object:
        if payload.__class__ is not bytes or len(payload) != size:
            raise _refusal(payload, f"{size} bytes of {little.str} {list(shape)}")
        array = np.ndarray(shape, little, buffer=payload).copy()
        return array if dtype == little else array.byteswap().view(dtype)

    return unpack


def _number(dtype: np.dtype[Any]) -> Slot:
    limits = np.iinfo(dtype)
    low, high = max(int(limits.min), int(_INT64.min)), min(int(limits.max), int(_INT64.max))
    scalar_type = dtype.type

    def pack(value: Any) -> int | None:
        if value.__class__ is not int:
            if value.__class__ is not scalar_type and not (
                isinstance(value, np.integer) and value.dtype == dtype
            ):
                return None
            value = int(value)
        return value if low <= value <= high else None

    def unpack(payload: Any) -> object:
        if payload.__class__ is not int or not low <= payload <= high:
            raise _refusal(payload, f"a whole number of {dtype.name}")
        return scalar_type(payload)

    return Slot("int", dtype.newbyteorder("<").str, (), pack, unpack)


def _pack_text(value: Any) -> str | None:
    if value.__class__ is not str:
        return None
    if not value.isascii():
        try:
            value.encode()
        except UnicodeEncodeError:  # a lone surrogate
            return None
    return value


def _unpack_text(payload: Any) -> object:
    if payload.__class__ is not str:
        raise _refusal(payload, "text")
    return payload


def _refusal(payload: object, expected: str) -> EvidenceError:
    return EvidenceError(
        "a recorded value isn't of its space",
        expected=expected,
        actual=f"{type(payload).__name__} {payload!r:.80}",
        fix="the recording was changed, or it is read with other spaces than its own",
    )


# -- Spaces without a fixed shape, as canonical JSON

Holds = Callable[[Any], bool]
Count = Callable[[Any], int | None]
Restore = Callable[[Any], Any]

DICTS: Final = frozenset({dict, OrderedDict})


def json_slot(space: Space[Any]) -> Slot:
    """The slot of any space as canonical JSON; packs only what can be built again from its text."""
    is_value, as_declared = holds(space), restore(space)

    def pack(value: Any) -> str | None:
        if not is_value(value):
            return None
        text = to_json(value)
        return text if is_exact(text) else None

    def unpack(payload: Any) -> object:
        try:
            return as_declared(from_json(payload))
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            if isinstance(error, EvidenceError):
                raise
            raise _refusal(payload, f"{space!r:.200}") from error

    return Slot("json", "", (), pack, unpack)


def holds(space: Space[Any]) -> Holds:
    """A test if a value is exactly of the structure, dtypes and shapes of the space."""
    leaf = slot(space)
    if leaf is not None:
        pack = leaf.pack
        return lambda value: pack(value) is not None
    if isinstance(space, Box | MultiBinary | MultiDiscrete):
        return _holds_array(space.dtype, tuple(space.shape))
    if isinstance(space, Dict):
        return _holds_dict({key: holds(inner) for key, inner in space.spaces.items()})
    if isinstance(space, Tuple):
        return _holds_tuple([holds(inner) for inner in space.spaces])
    if isinstance(space, Sequence):
        if space.stack:
            counted = _count(space.feature_space)
            return lambda value: counted(value) is not None
        item = holds(space.feature_space)
        return lambda value: type(value) is tuple and all(map(item, value))
    if isinstance(space, OneOf):
        return _holds_arm([holds(inner) for inner in space.spaces])
    return _holds_graph(space) if isinstance(space, Graph) else partial(contains, space)


def contains(space: Space[Any], value: object) -> bool:
    """True if the space's own `contains` says so; a value that it can't judge isn't one of its."""
    try:
        return bool(space.contains(value))
    except Exception:  # foreign code may do anything
        return False


def _holds_array(dtype: np.dtype[Any], shape: tuple[int, ...]) -> Holds:
    return lambda value: type(value) is np.ndarray and value.dtype == dtype and value.shape == shape


def _holds_dict(fields: dict[Any, Holds]) -> Holds:
    return lambda value: (
        type(value) in DICTS
        and value.keys() == fields.keys()
        and all(is_field(value[key]) for key, is_field in fields.items())
    )


def _holds_tuple(items: list[Holds]) -> Holds:
    return lambda value: (
        type(value) is tuple
        and len(value) == len(items)
        and all(is_item(part) for is_item, part in zip(items, value, strict=True))
    )


def _holds_arm(arms: list[Holds]) -> Holds:
    return lambda value: (
        type(value) is tuple
        and len(value) == 2
        and type(value[0]) in (int, np.int64)
        and 0 <= value[0] < len(arms)
        and arms[value[0]](value[1])
    )


def _holds_graph(space: Graph) -> Holds:
    nodes = _count(space.node_space)
    edges = None if space.edge_space is None else _count(space.edge_space)

    def is_graph(value: Any) -> bool:
        if type(value) is not GraphInstance or nodes(value.nodes) is None:
            return False
        links = value.edge_links
        if value.edges is None or links is None:
            return value.edges is None and links is None
        count = None if edges is None else edges(value.edges)
        is_links = type(links) is np.ndarray and links.dtype.kind in "iu"
        return count is not None and is_links and links.shape == (count, 2)

    return is_graph


def _count(space: Space[Any]) -> Count:
    """Counts the values of the space that are stacked in a value as `batch_space` does, or None."""
    if isinstance(space, Box | Discrete | MultiBinary | MultiDiscrete):
        dtype, shape = space.dtype, tuple(space.shape or ())
        return lambda value: (
            len(value)
            if type(value) is np.ndarray
            and value.dtype == dtype
            and value.ndim
            and value.shape[1:] == shape
            else None
        )
    if isinstance(space, Dict):
        fields = {key: _count(inner) for key, inner in space.spaces.items()}
        return lambda value: (
            _agreed([counted(value[key]) for key, counted in fields.items()])
            if type(value) in DICTS and value.keys() == fields.keys()
            else None
        )
    if isinstance(space, Tuple):
        items = [_count(inner) for inner in space.spaces]
        return lambda value: (
            _agreed([counted(part) for counted, part in zip(items, value, strict=True)])
            if type(value) is tuple and len(value) == len(items)
            else None
        )
    item = holds(space)
    return lambda value: len(value) if type(value) is tuple and all(map(item, value)) else None


def _agreed(counts: list[int | None]) -> int | None:
    return counts[0] if len(set(counts)) == 1 else None


def restore(space: Space[Any], *, is_stacked: bool = False) -> Restore:
    """Gives what canonical JSON holds as plain numbers the dtypes that the space declares.

    Args:
        is_stacked: for many values of the space, stacked as `batch_space` does.
    """
    if isinstance(space, Dict):
        fields = {key: restore(part, is_stacked=is_stacked) for key, part in space.spaces.items()}
        return lambda value: {key: fields[key](item) for key, item in value.items()}
    if isinstance(space, Tuple):
        items = [restore(part, is_stacked=is_stacked) for part in space.spaces]
        return lambda value: tuple(item(part) for item, part in zip(items, value, strict=True))
    if isinstance(space, Discrete) and not is_stacked:
        return space.dtype.type
    if isinstance(space, Box | Discrete | MultiBinary | MultiDiscrete):
        return _restore_array(space.dtype)
    if is_stacked:  # spaces that `batch_space` doesn't stack: a tuple of their values
        item = restore(space)
        return lambda value: tuple(map(item, value))
    if isinstance(space, Sequence):
        part = restore(space.feature_space, is_stacked=space.stack)
        return part if space.stack else lambda value: tuple(map(part, value))
    if isinstance(space, OneOf):
        arms = [restore(inner) for inner in space.spaces]
        return lambda value: (np.int64(value[0]), arms[value[0]](value[1]))
    return _restore_graph(space) if isinstance(space, Graph) else _same


def _restore_array(dtype: np.dtype[Any]) -> Restore:
    def as_declared(value: Any) -> Any:
        if type(value) is np.ndarray:
            return value.astype(dtype, copy=False)  # canonical JSON knows one order of bytes only
        return dtype.type(value) if type(value) in (bool, int, float) else value

    return as_declared


def _restore_graph(space: Graph) -> Restore:
    nodes = restore(space.node_space, is_stacked=True)
    edges = _same if space.edge_space is None else restore(space.edge_space, is_stacked=True)
    return lambda value: GraphInstance(
        nodes(value.nodes), None if value.edges is None else edges(value.edges), value.edge_links
    )


def _same(value: Any) -> Any:
    return value
