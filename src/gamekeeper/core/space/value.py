"""Values of spaces without a fixed shape as canonical JSON, and back.

Structure, dtypes and shapes must be exact, bounds aren't looked at. A space class that we don't
know is asked by its own `contains`.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
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
    Tuple,
)

from gamekeeper.core.canon import from_json, is_exact, to_json
from gamekeeper.core.space.leaf import Slot, slot
from gamekeeper.errors import EvidenceError

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
            raise EvidenceError(
                "a recorded value isn't of its space",
                expected=f"{space!r:.200}",
                seen=f"{payload!r:.80}",
                mend="the recording was changed, or it is read with other spaces than its own",
            ) from error

    return Slot("json", "", (), pack, unpack)


def holds(space: Space[Any]) -> Holds:
    """Whether a value is exactly of the structure, dtypes and shapes of the space."""
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
    if isinstance(space, Graph):
        return _holds_graph(space)
    return _asked(space)


def _asked(space: Space[Any]) -> Holds:
    def asked(value: Any) -> bool:
        try:
            return bool(space.contains(value))
        except Exception:  # foreign code: a value that it can't judge isn't one of its values
            return False

    return asked


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
    """How many values of the space a value stacks as `batch_space` does; None where it doesn't."""
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


def restore(space: Space[Any]) -> Restore:
    """Gives what canonical JSON holds as plain numbers the dtypes that the space declares."""
    if isinstance(space, Discrete):
        return space.dtype.type
    if isinstance(space, Box | MultiBinary | MultiDiscrete):
        return _restore_array(space.dtype)
    if isinstance(space, Dict):
        fields = {key: restore(inner) for key, inner in space.spaces.items()}
        return lambda value: {key: fields[key](item) for key, item in value.items()}
    if isinstance(space, Tuple):
        return _restore_tuple([restore(inner) for inner in space.spaces])
    if isinstance(space, Sequence):
        if space.stack:
            return _restore_stack(space.feature_space)
        item = restore(space.feature_space)
        return lambda value: tuple(map(item, value))
    if isinstance(space, OneOf):
        arms = [restore(inner) for inner in space.spaces]
        return lambda value: (np.int64(value[0]), arms[value[0]](value[1]))
    if isinstance(space, Graph):
        return _restore_graph(space)
    return _same


def _restore_array(dtype: np.dtype[Any]) -> Restore:
    def as_declared(value: Any) -> Any:
        if type(value) is np.ndarray:
            return value.astype(dtype, copy=False)  # canonical JSON knows one order of bytes only
        return dtype.type(value) if type(value) in (bool, int, float) else value

    return as_declared


def _restore_tuple(items: list[Restore]) -> Restore:
    return lambda value: tuple(item(part) for item, part in zip(items, value, strict=True))


def _restore_stack(space: Space[Any]) -> Restore:
    if isinstance(space, Box | Discrete | MultiBinary | MultiDiscrete):
        return _restore_array(space.dtype)
    if isinstance(space, Dict):
        fields = {key: _restore_stack(inner) for key, inner in space.spaces.items()}
        return lambda value: {key: fields[key](item) for key, item in value.items()}
    if isinstance(space, Tuple):
        return _restore_tuple([_restore_stack(inner) for inner in space.spaces])
    item = restore(space)
    return lambda value: tuple(map(item, value))


def _restore_graph(space: Graph) -> Restore:
    nodes = _restore_stack(space.node_space)
    edges = _same if space.edge_space is None else _restore_stack(space.edge_space)
    return lambda value: GraphInstance(
        nodes(value.nodes), None if value.edges is None else edges(value.edges), value.edge_links
    )


def _same(value: Any) -> Any:
    return value
