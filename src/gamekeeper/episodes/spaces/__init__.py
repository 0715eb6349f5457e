"""The leaves of a Gymnasium space, and values packed into them and back, bit for bit.

A leaf is what stands in one column: an array, a whole number, a text, or the canonical JSON of what
has no fixed shape (Sequence, Graph, OneOf, an array of long doubles, a class that we don't know).
A value is packed only where it is exactly of the declared structure, dtype and shape. Bounds aren't
looked at: NaN and numbers out of bounds are packed as they are.

Granted as exact, because nothing is lost by it: an OrderedDict for a dict; an int for a scalar of a
Discrete space, which unpacks as `space.dtype`; a scalar of the very dtype for an array of no
dimensions, which unpacks as such an array.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any, Final

from gymnasium.spaces import Dict, Space, Tuple

from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.spaces.nesting import check_extent
from gamekeeper.episodes.spaces.slots import DICTS, Pack, Payload, Slot, json_slot, slot
from gamekeeper.episodes.spaces.space_json import UnknownSpace, space_from_json, space_to_json
from gamekeeper.errors import EvidenceError

__all__ = ["Codec", "Leaf", "Payload", "UnknownSpace", "leaves", "space_from_json", "space_to_json"]

_RESERVED: Final = re.compile("[\x00-\x1f%/@\x7f\ud800-\udfff]")  # in a key within a path
_ABSENT: Final = object()

_PackAll = Callable[[Any], tuple[Payload, ...] | None]
_Fill = Callable[[Any, list[Payload]], bool]
_Build = Callable[[Iterator[Any]], object]


@dataclass(frozen=True, slots=True)
class Leaf:
    """The part of a space that one column holds.

    Args:
        path: "" for the root; keys of Dict, in sorted order, and indices of Tuple, joined by "/".
            In a key "%", "/", "@" and control characters are percent-encoded ("%25", "%2F"); "%"
            is the empty key, and "%:1" the key 1, which is no text.
        kind: "list" (numbers of a fixed count), "bytes" (C bytes: uint8, bool, more than 256
            elements or none), "int" (Discrete), "text" (Text) or "json" (canonical JSON).
        dtype: little-endian, as numpy writes it ("<f4", "|u1"); "" for text and json.
        shape: of the array; () for all others.
    """

    path: str
    kind: str
    dtype: str
    shape: tuple[int, ...]


class Codec:
    """Packs values of one space into payloads, one a leaf, and gives them back.

    Attributes:
        leaves: in the order of the payloads.
        signature: a digest of the leaves, equal for equal spaces; bounds aren't in it.
        pack: the payloads of a value: bytes for "list" and "bytes" (C order, little-endian), int,
            str. None where the value isn't exactly of the declared structure, dtypes and shapes.
        pack_one: the same with the bare payload, for a space of one leaf; None for all others.
    """

    __slots__ = ("_build", "leaves", "pack", "pack_one", "signature", "space")

    pack: _PackAll
    pack_one: Pack | None

    def __init__(self, space: Space[Any]) -> None:
        """Takes the space apart.

        Raises:
            EnvError: the space is nested too deep or has too many parts to be recorded.
        """
        check_extent(space)
        node = _node(space, "")
        self.space = space
        self.leaves: tuple[Leaf, ...] = tuple(node.leaves)
        described = [(leaf.path, leaf.kind, leaf.dtype, leaf.shape) for leaf in self.leaves]
        text = json.dumps(described).encode()
        self.signature = blake2b(text, digest_size=16).hexdigest()
        self.pack, self.pack_one = _packers(node)
        self._build = node.build

    def unpack(self, payloads: Sequence[Payload]) -> Any:
        """The value whose payloads these are; its arrays are fresh and writable.

        Raises:
            EvidenceError: the payloads aren't those of a value of this space.
        """
        if len(payloads) != len(self.leaves):
            raise EvidenceError(
                "a recorded value hasn't the leaves of its space",
                expected=f"{len(self.leaves)} of {self.space!r:.200}",
                actual=f"{len(payloads)}",
                fix="read it with the spaces of its own recording",
            )
        return self._build(iter(payloads))

    def __reduce__(self) -> tuple[type[Codec], tuple[Space[Any]]]:
        return Codec, (self.space,)

    def __repr__(self) -> str:
        return f"Codec({self.space!r})"


def leaves(space: Space[Any]) -> tuple[Leaf, ...]:
    """The leaves of a space, depth first, the keys of a Dict in sorted order."""
    return tuple(_node(space, "").leaves)


@dataclass(frozen=True, slots=True)
class _Node:
    """One space within a space: how its payloads are appended to a list, and taken from one."""

    leaves: list[Leaf]
    fill: _Fill
    build: _Build
    pack: Pack | None = None  # of a leaf


def _node(space: Space[Any], path: str) -> _Node:
    if isinstance(space, Dict):
        return _dict_node(space, path)
    if isinstance(space, Tuple):
        return _tuple_node(space, path)
    return _leaf_node(slot(space) or json_slot(space), path)


def _leaf_node(leaf: Slot, path: str) -> _Node:
    pack, unpack = leaf.pack, leaf.unpack

    def fill(value: Any, out: list[Payload]) -> bool:
        payload = pack(value)
        if payload is None:
            return False
        out.append(payload)
        return True

    described = Leaf(path, leaf.kind, leaf.dtype, leaf.shape)
    return _Node([described], fill, lambda payloads: unpack(next(payloads)), pack)


def _dict_node(space: Dict, path: str) -> _Node:
    texts = sorted(key for key in space.spaces if isinstance(key, str))
    keys = [*texts, *sorted({*space.spaces} - {*texts}, key=to_json)]
    nodes = {key: _node(space.spaces[key], _below(path, _segment(key))) for key in keys}
    fills = [(key, node.fill) for key, node in nodes.items()]
    own_order, count = tuple(space.spaces), len(fills)

    def fill(value: Any, out: list[Payload]) -> bool:
        if value.__class__ not in DICTS or len(value) != count:
            return False
        for key, fill_field in fills:  # noqa: SIM110 - this runs at each step
            if not fill_field(value.get(key, _ABSENT), out):
                return False
        return True

    def build(payloads: Iterator[Any]) -> object:
        built = {key: node.build(payloads) for key, node in nodes.items()}
        return {key: built[key] for key in own_order}

    return _Node([leaf for node in nodes.values() for leaf in node.leaves], fill, build)


def _tuple_node(space: Tuple[Any], path: str) -> _Node:
    nodes = [_node(inner, _below(path, str(i))) for i, inner in enumerate(space.spaces)]
    fills, count = [node.fill for node in nodes], len(nodes)

    def fill(value: Any, out: list[Payload]) -> bool:
        if value.__class__ is not tuple or len(value) != count:
            return False
        for item, fill_item in zip(value, fills, strict=True):  # noqa: SIM110 - as above
            if not fill_item(item, out):
                return False
        return True

    def build(payloads: Iterator[Any]) -> object:
        return tuple([node.build(payloads) for node in nodes])

    return _Node([leaf for node in nodes for leaf in node.leaves], fill, build)


def _packers(node: _Node) -> tuple[_PackAll, Pack | None]:
    one, fill = node.pack, node.fill

    def pack(value: Any) -> tuple[Payload, ...] | None:
        out: list[Payload] = []
        return tuple(out) if fill(value, out) else None

    def pack_only(value: Any) -> Payload | None:
        out: list[Payload] = []
        return out[0] if fill(value, out) else None

    return pack, one or (pack_only if len(node.leaves) == 1 else None)


def _below(path: str, segment: str) -> str:
    return f"{path}/{segment}" if path else segment


def _segment(key: object) -> str:
    """A key as one part of a path, different for different keys."""
    if isinstance(key, str):
        return _RESERVED.sub(_percent, key) or "%"
    return f"%:{_segment(to_json(key))}"


def _percent(match: re.Match[str]) -> str:
    code = ord(match[0])
    return f"%{code:02X}" if code < 256 else f"%u{code:04X}"
