"""Numpy's arrays and scalars as canonical JSON, and back.

The forms stand in `canon`. Numbers are flat lists in C order up to 64 elements, base64 of little-endian C bytes beyond;
text, bytes, objects and long doubles (whose bytes have holes) are lists always.
"""

from __future__ import annotations

import math
import re
from base64 import b64decode, b64encode
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gamekeeper.core.canon_text import base64, encode

Array = npt.NDArray[Any]
DType = np.dtype[Any]

_LISTED: Final = 64  # elements
_ITEM: Final = 65_536  # bytes of one element of text: a short JSON must not ask for gigabytes
_DTYPE: Final = re.compile(r"[<|](?:[biufc]\d+|[mM]8(?:\[\d*[A-Za-z]+\])?|[USV]\d+|O)")
_WORDS: Final = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}

# Scalars that a kind names; `np.bool_`, `np.int64`, `np.float64` are plain.
SCALARS: Final[dict[str, type[np.generic]]] = {
    cls.__name__: cls
    for cls in (
        np.int8, np.int16, np.int32, np.uint8, np.uint16, np.uint32, np.uint64,
        np.float16, np.float32, np.complex64, np.complex128,
    )
}  # fmt: skip


def number_text(numbers: Sequence[object]) -> str:
    """A list of bools, ints and floats as JSON, with "nan", "inf" and "-inf" for what JSON doesn't know."""
    try:
        return encode(numbers)
    except ValueError:
        return encode([_word(number) for number in numbers])


def _word(number: object) -> object:
    if isinstance(number, float) and not math.isfinite(number):
        return "nan" if math.isnan(number) else "inf" if number > 0 else "-inf"
    return number


def number(value: object) -> Any:
    """The number that one element of `number_text` stands for."""
    return _WORDS[value] if isinstance(value, str) else value


def scalar_text(value: np.generic, write: Callable[[object], str]) -> str | None:
    """The text of a numpy scalar; None where it can't be read back."""
    kind, plain = _kind(value.dtype), None
    if kind in SCALARS:
        plain = value.item()
        parts = [plain.real, plain.imag] if isinstance(plain, complex) else [plain]
        text = number_text(parts)
        return f'{{"$":"{kind}","v":{text if len(parts) == 2 else text[1:-1]}}}'
    if kind == "int64":  # np.longlong where np.int64 is np.long, or the reverse
        return repr(int(value))
    text_of_array = array_text(np.asarray(value), write)
    return None if text_of_array is None else f'{{"$":"scalar","v":{text_of_array}}}'


@lru_cache(maxsize=256)
def _kind(dtype: DType) -> str:
    return dtype.name


def array_text(array: Array, write: Callable[[object], str]) -> str | None:
    """The text of an array; None for a dtype that can't be read back by its name.

    Args:
        array: of any dtype, shape, strides and byte order.
        write: gives the text of an element of an object array.
    """
    dtype = array.dtype
    if dtype.names is not None:
        return _record_text(array, write)
    head = _head(dtype, array.shape)
    if head is None:
        return None
    return f'{head}"v":{_values_text(array, write)}}}'


@lru_cache(maxsize=1024)
def _head(dtype: DType, shape: tuple[int, ...]) -> str | None:
    """The text up to the values."""
    name = _dtype_name(dtype)
    if name is None:
        return None
    sides = ",".join(map(str, shape))
    return f'{{"$":"ndarray","dtype":{encode(name)},"shape":[{sides}],'


def _dtype_name(dtype: DType) -> str | None:
    """The name under which `_dtype` finds this dtype, little-endian; None where there is none."""
    if dtype.kind in "fc" and dtype.itemsize > (8 if dtype.kind == "f" else 16):
        return "longdouble" if dtype.kind == "f" else "clongdouble"
    if dtype.kind == "T":
        return "T" if dtype == np.dtype("T") else None
    little = dtype.newbyteorder("<")
    name = str(little.str)
    if not _DTYPE.fullmatch(name) or (dtype.kind in "USV" and dtype.itemsize > _ITEM):
        return None
    return name if np.dtype(name) == little else None


def _values_text(array: Array, write: Callable[[object], str]) -> str:
    kind = array.dtype.kind
    if kind in "OTU":
        return "[" + ",".join([write(item) for item in array.ravel().tolist()]) + "]"
    if kind == "S":
        return encode([b64encode(item).decode() for item in array.ravel().tolist()])
    if kind in "mM":
        array, kind = array.astype(array.dtype.newbyteorder("=")).view(np.int64), "i"
    if kind == "c":
        array, kind = _parts(array), "f"
    if kind == "f" and array.dtype.itemsize > 8:
        return encode([str(item) for item in array.ravel()])
    if array.size <= _LISTED and kind != "V":
        return number_text(array.ravel().tolist())
    return base64(_canonical(array).tobytes())


def _parts(array: Array) -> Array:
    """[..., 2] real and imaginary parts."""
    return np.stack([array.real, array.imag], axis=-1)


def _canonical(array: Array) -> Array:
    """Equal arrays with equal bytes: little-endian, one NaN, bools of 0 and 1."""
    kind = array.dtype.kind
    if kind == "b":
        return array.view(np.uint8) != 0
    array = array.astype(array.dtype.newbyteorder("<"), copy=False)
    if kind == "f":
        lost = np.isnan(array)
        if lost.any():
            array = np.where(lost, array.dtype.type(np.nan), array).astype(array.dtype, copy=False)
    return array


def _record_text(array: Array, write: Callable[[object], str]) -> str | None:
    names = array.dtype.names or ()
    fields = {name: array.dtype[name] for name in names}
    packed = np.dtype([(name, fields[name].base, fields[name].shape) for name in names])
    if packed != array.dtype:  # titles, offsets, holes
        return None
    texts = {name: array_text(array[name], write) for name in names}
    if None in texts.values():
        return None
    sides = ",".join(map(str, array.shape))
    columns = ",".join(f"[{write(name)},{text}]" for name, text in texts.items())
    return f'{{"$":"record","shape":[{sides}],"v":[{columns}]}}'


# Reading


def read_scalar(kind: str, value: Any) -> np.generic:
    """The numpy scalar that a kind of `SCALARS` and its value stand for."""
    plain = complex(number(value[0]), number(value[1])) if isinstance(value, list) else number(value)
    return SCALARS[kind](plain)


def read_array(name: str, shape: Sequence[int], values: Any) -> Array:
    """The array that an "ndarray" object stands for, fresh and writable.

    Raises:
        ValueError, TypeError, OverflowError: dtype, shape and values don't fit together.
    """
    sides = tuple(shape)
    if not all(type(side) is int and side >= 0 for side in sides):
        raise ValueError(f"no shape: {sides}")
    dtype = _dtype(name)
    count = math.prod(sides)
    if isinstance(values, str):
        data = b64decode(values, validate=True)
        if len(data) != count * dtype.itemsize:
            raise ValueError(f"{len(data)} bytes for shape {sides} of {name}")
        return np.ndarray(sides, dtype, buffer=data).copy()
    wide = dtype.kind == "c"
    if len(values) != count * (2 if wide else 1):
        raise ValueError(f"{len(values)} values for shape {sides} of {name}")
    return _filled(sides, dtype, values)


def _filled(shape: tuple[int, ...], dtype: DType, values: list[Any]) -> Array:
    array = np.empty(math.prod(shape), dtype)
    if dtype.kind == "c":
        real = np.longdouble if dtype.itemsize > 16 else np.float64
        parts = np.array([real(number(value) if real is np.float64 else value) for value in values], real)
        array.real, array.imag = parts[0::2], parts[1::2]
    elif dtype.kind == "f" and dtype.itemsize > 8:
        array[:] = [np.longdouble(value) for value in values]
    elif dtype.kind in "mM":
        array.view(np.int64)[:] = values
    else:
        read: Callable[[Any], Any] = number if dtype.kind == "f" else _same
        read = b64decode if dtype.kind == "S" else read
        for i, value in enumerate(values):
            array[i] = read(value)
    return array.reshape(shape)


def _same(value: Any) -> Any:
    return value


def _dtype(name: str) -> DType:
    if name in ("longdouble", "clongdouble", "T"):
        return np.dtype(name)
    if not isinstance(name, str) or not _DTYPE.fullmatch(name):
        raise ValueError(f"no dtype: {name!r}")
    dtype = np.dtype(name)
    if dtype.kind in "USV" and dtype.itemsize > _ITEM:
        raise ValueError(f"elements of {dtype.itemsize} bytes")
    return dtype


def read_record(shape: Sequence[int], columns: Sequence[tuple[str, Array]]) -> Array:
    """The structured array that a "record" object stands for."""
    sides = tuple(shape)
    for name, column in columns:
        if not isinstance(column, np.ndarray) or column.shape[: len(sides)] != sides:
            raise ValueError(f"field {name!r} isn't of shape {sides}")
    array = np.empty(sides, [(name, column.dtype, column.shape[len(sides) :]) for name, column in columns])
    for name, column in columns:
        array[name] = column
    return array
