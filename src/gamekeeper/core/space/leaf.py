"""One leaf of a space: how its value is packed into bytes, a whole number or a text, and back."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete, MultiBinary, MultiDiscrete, Space, Text

from gamekeeper.errors import EvidenceError

Payload = bytes | int | str
Pack = Callable[[Any], Payload | None]
Unpack = Callable[[Any], object]

_LISTED: Final = 256  # elements: more stand as plain bytes in their column
_INT64: Final = np.iinfo(np.int64)


@dataclass(frozen=True, slots=True)
class Slot:
    """What a column holds of one leaf, and both ways there.

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
    pack = _pack_array(dtype, shape) if dtype == little else _pack_swapped(dtype, shape)
    return Slot(
        "bytes" if is_plain else "list",
        little.str,
        shape,
        pack,
        _unpack_array(dtype, little, shape),
    )


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


def _pack_swapped(dtype: np.dtype[Any], shape: tuple[int, ...]) -> Pack:
    """As declared in an order of bytes that isn't little-endian."""
    pack_as_is = _pack_array(dtype, shape)

    return lambda value: None if pack_as_is(value) is None else _little(value)


def _little(value: Any) -> bytes:
    """The C bytes of an array or of a scalar of numpy, which is always in the machine's order."""
    little = value.dtype.newbyteorder("<")
    data: bytes = (value if value.dtype == little else value.byteswap()).tobytes()
    return data


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
    text: str = value
    return text


def _unpack_text(payload: Any) -> object:
    if payload.__class__ is not str:
        raise _refusal(payload, "text")
    return payload


def _refusal(payload: object, expected: str) -> EvidenceError:
    return EvidenceError(
        "a recorded value isn't of its space",
        expected=expected,
        seen=f"{type(payload).__name__} {payload!r:.80}",
        mend="the recording was changed, or it is read with other spaces than its own",
    )
