"""How observations and actions are packed on their way to the tape."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from gamekeeper.core.layout import LARGE_BYTES, Seat, Side
from gamekeeper.game.capture.sink import Sink

Pack = Callable[[Any], Any]
PATIENCE_S: Final = 0.0005  # between looks for a free slot, while the writer catches up


def observation_packer(side: Side | None, sink: Sink) -> Pack:
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
    while sink.tape.turns:
        sink.keep_up()  # raises where the writer failed: then no slot is ever free
        time.sleep(PATIENCE_S)
        place = sink.rings.put(value)
        if place is not None:
            return place
    return pack(value)


def action_packer(seat: Seat) -> Pack:
    """As the action space's codec packs; a whole number must also be of the episode's first type.

    Environments treat int and numpy.int64 differently (`action is 1`, overflow, JSON), so a replay
    hands over what was handed over; the type is kept once for each agent and episode.
    """
    side = seat.action
    if side is None:
        return nothing
    codec = side.codec
    pack: Pack = codec.pack_one or codec.pack
    if len(codec.leaves) != 1 or codec.leaves[0].kind != "int" or codec.leaves[0].path:
        return pack

    def pack_whole(action: Any) -> Any:
        kind = action.__class__
        if kind is not seat.acts_as:
            if seat.acts_as is not None or pack(action) is None:
                return None
            seat.acts_as = seat.action_type = kind
        return pack(action) if kind is int else int(action)

    return pack_whole


def other_whole(seat: Seat, action: Any) -> int | None:
    """The payload of a whole number of its space that is of another type than the first was."""
    if seat.action is None or seat.acts_as is None:
        return None
    pack = seat.action.codec.pack_one
    payload = None if pack is None else pack(action)
    return payload if payload.__class__ is int else None


def nothing(value: object) -> None:
    """Packs no value: the agent has no known space."""
    return
