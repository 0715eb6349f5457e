"""Numpy's arrays and scalars as canonical JSON, and back; the package's docstring has the forms.

Numbers are a flat list in C order up to 64 elements, base64 of little-endian C bytes beyond. Texts,
bytes, objects and long doubles (whose bytes have holes) are lists always.
"""

import math
import re
from base64 import b64decode, b64encode
from collections.abc import Callable, Sequence
from decimal import Decimal
from functools import lru_cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from gamekeeper.episodes.canonical.json_text import base64, encode, number_text, tagged

Array = npt.NDArray[Any]
DType = np.dtype[Any]
Write = Callable[[object], str]

_LISTED: Final = 64  # elements
_ITEM_BYTES: Final = 65_536  # of one text element: a short JSON must not ask for gigabytes
_DTYPE: Final = re.compile(r"[<|](?:[biufc]\d+|[mM]8(?:\[\d*[A-Za-z]+\])?|[USV]\d+|O)")
_WORDS: Final = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}

# Scalars that a kind names; `np.bool_`, `np.int64` and `np.float64` are plain.
SCALARS: Final[dict[str, type[np.generic]]] = {
    cls.__name__: cls
    for cls in (
        *(np.int8, np.int16, np.int32),
        *(np.uint8, np.uint16, np.uint32, np.uint64),
        *(np.float16, np.float32),
        *(np.complex64, np.complex128),
    )
}
_KINDS: Final = {cls: kind for kind, cls in SCALARS.items()}


def scalar_text(value: np.generic, write: Write) -> str | None:
    """The text of a numpy scalar; None where it can't be read back."""
    kind = _KINDS.get(type(value)) or value.dtype.name  # np.longlong is of dtype int64
    if kind in SCALARS:
        plain = value.item()
        if isinstance(plain, complex):
            return tagged(kind, number_text([plain.real, plain.imag]))
        return tagged(kind, number_text([plain])[1:-1])
    if kind == "int64":
        return repr(int(value))
    text = array_text(np.asarray(value), write)
    return None if text is None else tagged("scalar", text)


def array_text(array: Array, write: Write) -> str | None:
    """The text of an array; None for a dtype that its name doesn't give back.

    Args:
        array: of any dtype, shape, strides and byte order.
        write: gives the text of an element of an object array.
    """
    if array.dtype.names:
        return _record_text(array, array.dtype.names, write)
    head = _head(array.dtype, array.shape)
    return None if head is None else f"{head}{_values_text(array, write)}}}"


@lru_cache(maxsize=1024)
def _head(dtype: DType, shape: tuple[int, ...]) -> str | None:
    """The text of an array up to its values."""
    name = _dtype_name(dtype)
    if name is None:
        return None
    return f'{{"$":"ndarray","dtype":{encode(name)},"shape":{encode(shape)},"v":'


def _dtype_name(dtype: DType) -> str | None:
    """The name under which `_dtype` finds this dtype, little-endian; None where it doesn't."""
    if dtype.kind in "fc" and dtype.itemsize > _WIDEST[dtype.kind]:
        return "longdouble" if dtype.kind == "f" else "clongdouble"
    if dtype.kind == "T":
        return "T" if dtype == np.dtype("T") else None
    little = dtype.newbyteorder("<")
    name = str(little.str)
    if not _DTYPE.fullmatch(name) or (dtype.kind in "USV" and dtype.itemsize > _ITEM_BYTES):
        return None
    return name if np.dtype(name) == little else None


_WIDEST: Final = {"f": 8, "c": 16}  # bytes; beyond are long doubles


def _values_text(array: Array, write: Write) -> str:
    kind = array.dtype.kind
    if kind in "OTU":
        return "[" + ",".join([write(item) for item in array.ravel().tolist()]) + "]"
    if kind == "S":
        return encode([b64encode(item).decode() for item in array.ravel().tolist()])
    if kind in "mM":
        array = array.astype(array.dtype.newbyteorder("=")).view(np.int64)
    if kind == "c":
        array = np.stack([array.real, array.imag], axis=-1)
    if array.dtype.kind == "f" and array.dtype.itemsize > 8:
        return encode(["nan" if np.isnan(item) else str(item) for item in array.ravel()])
    if array.size <= _LISTED and kind != "V":
        return number_text(array.ravel().tolist())
    return base64(_canonical(array).tobytes())


def _canonical(array: Array) -> Array:
    """Makes equal arrays have equal bytes: little-endian, one NaN, bools of 0 and 1."""
    if array.dtype.kind == "b":
        return np.not_equal(array.view(np.uint8), 0)
    array = array.astype(array.dtype.newbyteorder("<"), copy=False)
    if array.dtype.kind == "f" and np.isnan(array).any():
        array = array.copy()
        array[np.isnan(array)] = np.nan
    return array


def _record_text(array: Array, names: Sequence[str], write: Write) -> str | None:
    fields = {name: array.dtype[name] for name in names}
    packed = np.dtype([(name, field.base, field.shape) for name, field in fields.items()])
    if packed != array.dtype:  # it has titles, offsets or holes
        return None
    columns = []
    for name in names:
        text = array_text(array[name], write)
        if text is None:
            return None
        columns.append(f"[{write(name)},{text}]")
    return f'{{"$":"record","shape":{encode(array.shape)},"v":[{",".join(columns)}]}}'


def number(value: object) -> Any:
    """The number that one element of `number_text` stands for."""
    if isinstance(value, str):
        return _WORDS[value]
    if type(value) not in (int, float, bool):
        raise TypeError(f"{value!r} is no number")
    return value


def read_scalar(kind: str, value: Any) -> np.generic:
    """The numpy scalar of one of `SCALARS`.

    Raises:
        ValueError, TypeError, ArithmeticError, LookupError: the value isn't one of this kind.
    """
    cls = SCALARS[kind]
    with np.errstate(over="raise"):
        if issubclass(cls, np.complexfloating):
            return cls(complex(*map(number, value)))
        if issubclass(cls, np.floating):
            return cls(number(value))
    if type(value) is not int:
        raise TypeError(f"{value!r} is no whole number")
    return cls(value)


def read_array(name: str, shape: Sequence[int], values: Any) -> Array:
    """The array of an "ndarray" object, fresh and writable.

    Raises:
        ValueError, TypeError, ArithmeticError, LookupError: dtype, shape and values don't fit.
    """
    sides = _shape(shape)
    dtype = _dtype(name)
    count = math.prod(sides)
    if isinstance(values, str):
        data = b64decode(values, validate=True)
        if len(data) != count * dtype.itemsize or dtype.hasobject:
            raise ValueError(f"{len(data)} bytes for {sides} of {name}")
        return np.ndarray(sides, dtype, buffer=data).copy()
    if type(values) is not list or len(values) != count * (2 if dtype.kind == "c" else 1):
        raise ValueError(f"no values for {sides} of {name}")
    array = np.empty(count, dtype)
    with np.errstate(over="raise"):
        _fill(array, values)
    return array.reshape(sides)


def _fill(array: Array, values: list[Any]) -> None:
    """Puts the listed values into an array of one dimension."""
    kind, is_long = array.dtype.kind, array.dtype.itemsize > _WIDEST.get(array.dtype.kind, 1 << 30)
    if kind in "fc":
        numbers = list(map(long_double if is_long else number, values))
        if kind == "f":
            array[:] = numbers
        else:
            array.real, array.imag = numbers[0::2], numbers[1::2]
    elif kind == "S":
        array[:] = [b64decode(value, validate=True) for value in values]
    elif kind == "O":
        for i, value in enumerate(values):
            array[i] = value
    else:
        expected = {"b": bool, "U": str, "T": str}.get(kind, int)
        if not all(type(value) is expected for value in values):
            raise TypeError(f"not all of {values!r:.80} are {expected.__name__}")
        (array.view(np.int64) if kind in "mM" else array)[:] = values


def long_double(text: Any) -> np.longdouble:
    """The long double of its text.

    Raises:
        TypeError, ArithmeticError: it isn't one, or is beyond the largest.
    """
    if type(text) is not str:
        raise TypeError(f"{text!r} is no text")
    exact = Decimal(text)  # numpy answers with infinity, and a warning, where a text is too large
    if exact.is_finite() and abs(exact) > Decimal(str(np.finfo(np.longdouble).max)):
        raise OverflowError(f"{text} is too large")
    return np.longdouble(text)


def _shape(shape: Sequence[int]) -> tuple[int, ...]:
    sides = tuple(shape)
    if not all(type(side) is int and side >= 0 for side in sides):
        raise ValueError(f"no shape: {sides}")
    return sides


def _dtype(name: str) -> DType:
    if name in ("longdouble", "clongdouble", "T"):
        return np.dtype(name)
    if not isinstance(name, str) or not _DTYPE.fullmatch(name):
        raise ValueError(f"no dtype: {name!r}")
    dtype = np.dtype(name)
    if dtype.kind in "USV" and dtype.itemsize > _ITEM_BYTES:
        raise ValueError(f"elements of {dtype.itemsize} bytes")
    return dtype


def read_record(shape: Sequence[int], columns: Sequence[tuple[str, Array]]) -> Array:
    """The structured array of a "record" object.

    Raises:
        ValueError, TypeError: shape and fields don't fit.
    """
    sides = _shape(shape)
    for _, column in columns:
        if type(column) is not np.ndarray or column.shape[: len(sides)] != sides:
            raise ValueError(f"a field that isn't of shape {sides}")
    fields = [(name, column.dtype, column.shape[len(sides) :]) for name, column in columns]
    array = np.empty(sides, fields)
    for name, column in columns:
        array[name] = column
    return array
