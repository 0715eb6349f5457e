"""Packing of observations, actions, infos and nonconforming values on their way to the buffer."""

import marshal
import time
from collections.abc import Callable
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from gamekeeper.episodes.buffer import Buffer, LargePlace
from gamekeeper.episodes.canonical import to_json, type_name
from gamekeeper.episodes.canonical.opaque import plain_text
from gamekeeper.episodes.layout import LARGE_BYTES, AgentColumns, Layout, SpaceColumns

MASK: Final = "action_mask"
MOST_TEXTS: Final = 1024
_PLAIN: Final = frozenset({int, float, bool, str, type(None)})


class InfoTexts:
    """Turns infos into texts and remembers those it has seen.

    Small infos repeat (a position, a flag), and encoding one costs 1.3 us where finding it again
    costs 0.3. Only infos of plain values are remembered: marshal tells these apart to the bit.
    """

    __slots__ = ("_known",)

    def __init__(self) -> None:
        self._known: dict[bytes, str] = {}

    def text(self, info: dict[Any, Any]) -> tuple[str, bytes | None]:
        """An info that isn't empty as canonical JSON, and the mask in it as bytes.

        A mask of one-byte elements stands in the JSON by its dtype and shape only.
        """
        try:
            key = marshal.dumps(info, 2)
        except ValueError:  # holds something that marshal doesn't know
            key = b""
        known = self._known.get(key)
        if known is not None:
            return known, None
        mask = info.get(MASK)
        if mask.__class__ is np.ndarray and mask.itemsize == 1 and mask.dtype.kind in "biu":
            shape = "x".join(map(str, mask.shape))
            return to_json({**info, MASK: f"{mask.dtype.str} {shape}"}), mask.tobytes()
        text = to_json(info)
        if key and len(self._known) < MOST_TEXTS and _PLAIN.issuperset(map(type, info.values())):
            self._known[key] = text
        return text, None


WHOLES: Final = frozenset({int, *(np.dtype(code).type for code in "bhilqBHILQ")})
# what PettingZoo environments pay in; a bool or a text is no reward
FLOATS: Final = frozenset({float, *(np.dtype(code).type for code in "efd")})
REALS: Final = WHOLES | FLOATS
BOOLS: Final = frozenset({bool, np.bool_})
EXACT: Final = 1 << 53  # beyond it a whole number has no exact float64


class Missing:
    """Stands for a key that a dictionary should have had."""


MISSING: Final = Missing()


def nonconforming(field: str, value: object) -> str:
    """One entry of a row's `nonconforming` object: the value as it was, with its type."""
    if value is MISSING:
        return f'"{field}":{{"type":"missing"}}'
    return f'"{field}":{{"type":{to_json(type_name(value))},"value":{to_json(value)}}}'


def nonconforming_type(field: str, value: object) -> str:
    """The same for a value that stands in its column; only its type is another than usual."""
    return f'"{field}":{{"type":{to_json(type_name(value))}}}'


def reward_of(reward: Any) -> float | None:
    """`reward` if it is a real number that a float64 holds exactly, else None."""
    kind = reward.__class__
    if kind not in REALS or (kind in WHOLES and not -EXACT <= reward <= EXACT):
        return None
    return reward  # type: ignore[no-any-return]  # one of REALS


def flag_of(flag: Any, field: str, entries: list[str]) -> Any:
    """`flag` if it is a bool; else None, and the value as it was goes to `entries`."""
    if flag.__class__ in BOOLS:
        return flag
    entries.append(nonconforming(field, flag))
    return None


def type_name_of(kind: type) -> str:
    """`int`, `numpy.int64`: the name of a type as evidence spells it."""
    try:
        module, name = plain_text(kind.__module__), plain_text(kind.__name__)
    except KeyboardInterrupt:
        raise
    except BaseException:  # a metaclass may do anything
        return "object"
    return name if module == "builtins" else f"{module}.{name}"


MEMORY_BYTES: Final = 64 << 20  # of one ring, unless a few slots need more
FEWEST: Final = 2  # slots, however large: one is filled while the other is written
MOST: Final = 8192  # slots, however small
SLOT_BITS: Final = 24


class Ring:
    """Slots laid out like the source's memory, so that putting an array aside is one memory copy.

    The step puts, the writer opens and frees. The slot freed last is used first, so that memory is
    touched only as far as the writer lags behind.
    """

    def __init__(self, like: NDArray[Any]) -> None:
        """Allocates slots for arrays of the dtype, shape and axis order of `like`."""
        count = max(FEWEST, min(MOST, MEMORY_BYTES // max(like.nbytes, 1)))
        axes = sorted(range(like.ndim), key=lambda axis: -abs(like.strides[axis]))
        raw = np.empty((count, *(like.shape[axis] for axis in axes)), like.dtype)
        back = np.argsort(axes)
        self._slots = [slot.transpose(back) for slot in raw]
        self._free = list(range(count))

    def put(self, array: NDArray[Any]) -> int | None:
        """Copies `array` into a free slot and returns its number; None if there is none."""
        try:
            slot = self._free.pop()
        except IndexError:
            return None
        np.copyto(self._slots[slot], array)
        return slot

    def copy(self, slot: int) -> bytes:
        """The C bytes of `slot`, which stays taken."""
        data: bytes = self._slots[slot].tobytes()
        return data

    def open(self, slot: int, out: NDArray[np.uint8]) -> None:
        """Writes the C bytes of `slot` into `out`, [bytes], and frees the slot."""
        source = self._slots[slot]
        np.copyto(out.view(source.dtype).reshape(source.shape), source)
        self._free.append(slot)

    def release(self, slot: int) -> None:
        """Frees `slot` unopened."""
        self._free.append(slot)


class Rings:
    """One ring for each kind of array; a place is the number of the ring and of its slot in one."""

    def __init__(self) -> None:
        self._rings: list[Ring] = []
        self._by_kind: dict[tuple[Any, tuple[int, ...]], int] = {}

    def put(self, array: NDArray[Any]) -> LargePlace | None:
        """Puts `array` aside and returns its place; None if its ring is full."""
        kind = (array.dtype, array.shape)
        number = self._by_kind.get(kind)
        if number is None:
            number = len(self._rings)
            self._rings.append(Ring(array))
            self._by_kind[kind] = number
        slot = self._rings[number].put(array)
        return None if slot is None else LargePlace(number << SLOT_BITS | slot)

    def copy(self, place: int) -> bytes:
        """The C bytes of the array at `place`, which stays taken."""
        return self._rings[place >> SLOT_BITS].copy(place & (1 << SLOT_BITS) - 1)

    def release(self, place: int) -> None:
        """Frees a place whose array nobody will open."""
        self._rings[place >> SLOT_BITS].release(place & (1 << SLOT_BITS) - 1)

    def open(self, place: int, out: NDArray[np.uint8]) -> None:
        """Writes the C bytes of the array at `place` into `out`, [bytes], and frees the place."""
        self._rings[place >> SLOT_BITS].open(place & (1 << SLOT_BITS) - 1, out)


class Sink(Protocol):
    """Takes what a game puts on the buffer."""

    buffer: Buffer
    layout: Layout
    rings: Rings | None

    def keep_up(self) -> None:
        """Called every few turns and at an episode's end; may wait until the buffer is shorter."""

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Takes one rendered frame."""


Pack = Callable[[Any], Any]
PATIENCE_S: Final = 0.0005  # between looks for a free slot, while the writer catches up


def observation_packer(side: SpaceColumns | None, sink: Sink) -> Pack:
    """As the space's codec packs; a large array is put aside into a ring where the sink has one."""
    if side is None:
        return nothing
    codec = side.codec
    pack: Pack = codec.pack_one or codec.pack
    leaf = codec.leaves[0] if len(codec.leaves) == 1 else None
    if sink.rings is None or leaf is None or leaf.kind != "bytes" or leaf.path:
        return pack
    dtype, shape, put = np.dtype(leaf.dtype), leaf.shape, sink.rings.put
    if int(np.prod(shape, dtype=np.int64)) * dtype.itemsize < LARGE_BYTES:
        return pack

    def pack_large(value: Any) -> Any:
        if value.__class__ is np.ndarray and value.dtype == dtype and value.shape == shape:
            place = put(value)
            return _slot_or_bytes(value, sink, pack) if place is None else place
        return pack(value)

    return pack_large


def _slot_or_bytes(value: Any, sink: Sink, pack: Pack) -> Any:
    """Waits for a slot while the writer has turns to free slots of; then gives the bytes instead.

    A turn of more large observations than there are slots would wait for itself.
    """
    assert sink.rings is not None  # only who has rings puts aside
    while sink.buffer.turns:
        sink.keep_up()  # raises where the writer failed: then no slot is ever free
        time.sleep(PATIENCE_S)
        place = sink.rings.put(value)
        if place is not None:
            return place
    return pack(value)


def action_packer(columns: AgentColumns) -> Pack:
    """As the action space's codec packs; a whole number must also be of the episode's first type.

    Environments treat int and numpy.int64 differently (`action is 1`, overflow, JSON), so a replay
    hands over what was handed over; the type is kept once for each agent and episode.
    """
    side = columns.action
    if side is None:
        return nothing
    codec = side.codec
    pack: Pack = codec.pack_one or codec.pack
    if len(codec.leaves) != 1 or codec.leaves[0].kind != "int" or codec.leaves[0].path:
        return pack
    limits, widest = np.iinfo(np.dtype(codec.leaves[0].dtype)), np.iinfo(np.int64)
    low, high = max(int(limits.min), int(widest.min)), min(int(limits.max), int(widest.max))

    def pack_whole(action: Any) -> Any:
        kind = action.__class__
        if kind is not columns.acts_as:
            if columns.acts_as is not None or pack(action) is None:
                return None
            columns.acts_as = columns.action_type = kind
        number = action if kind is int else int(action)
        return number if low <= number <= high else None

    return pack_whole


def other_whole(columns: AgentColumns, action: Any) -> int | None:
    """The payload of a whole number of its space that is of another type than the first was."""
    if columns.action is None or columns.acts_as is None:
        return None
    pack = columns.action.codec.pack_one
    payload = None if pack is None else pack(action)
    return payload if payload.__class__ is int else None


def nothing(value: object) -> None:
    """Packs no value: the agent has no known space."""
    return
