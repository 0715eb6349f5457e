"""Description of a value that only its own code can build: its type, its repr, its content."""

import dataclasses
import re
from collections import deque
from collections.abc import Callable
from enum import Enum
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from gamekeeper.episodes.canonical.json_text import clean

_REPR: Final = 200  # characters
_ADDRESS: Final = re.compile(r"\bat 0x[0-9A-Fa-f]+|0x[0-9A-Fa-f]{8,}")


@dataclasses.dataclass(frozen=True, slots=True)
class Opaque:
    """A value that isn't built again: its type's name, and its repr or its content.

    Args:
        type: "module.Class".
        repr: without addresses, at most 200 characters; "" where there is a content.
        content: canonical JSON of what it held (fields, elements, the plain part of a subclass of
            a builtin), None where that isn't known.
    """

    type: str
    repr: str = ""
    content: str | None = None


def type_name(value: object) -> str:
    """The name of a value's type for a reader: `list`, `numpy.float32`, `module.Class`."""
    return value.type if type(value) is Opaque else class_name(type(value))


def class_name(cls: type) -> str:
    """The name of a class as `type_name` gives it; never raises."""
    try:
        module, name = plain_text(cls.__module__), plain_text(cls.__qualname__)
        return clean(name if module == "builtins" else f"{module}.{name}")
    except KeyboardInterrupt:
        raise
    except BaseException:  # a metaclass may do anything
        return "object"


def plain_text(value: object) -> str:
    """The `str` of a value as a text of the very class `str`, whose methods are Python's own."""
    return str.__str__(str(value))


def shown(value: object) -> str:
    """The repr of a value without the addresses in it, at most 200 characters."""
    try:
        text = str.__str__(repr(value))
    except KeyboardInterrupt:
        raise
    except BaseException:  # foreign code may do anything
        text = "<repr raises>"
    text = _ADDRESS.sub("at 0x?", clean(text[: 20 * _REPR]))
    return text if len(text) <= _REPR else text[: _REPR - 1] + "…"


def content_of(value: object) -> object:
    """Content of a value of a known family, as plainer values; None for all others.

    Known are enums, named tuples, dataclasses, subclasses of ndarray and of builtins, deques and
    mapping proxies. No code of the value's class is run, but for attributes of a dataclass.
    """
    if isinstance(value, Enum):
        return {"name": value._name_, "value": value._value_}
    if isinstance(value, np.ndarray):
        return _array_content(value)
    fields = getattr(type(value), "_fields", None)
    if isinstance(value, tuple) and isinstance(fields, tuple):
        return dict(zip(fields, tuple.__iter__(value), strict=True))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    for base, plain in _BASES.items():
        if isinstance(value, base):
            return plain(value)
    return None


def _array_content(value: np.ndarray[Any, Any]) -> object:
    if isinstance(value, np.ma.MaskedArray):
        mask = np.ma.getmaskarray(value)
        hidden = value.data.copy()
        hidden[mask] = np.zeros((), value.dtype)  # the data below a mask isn't part of the value
        return {"data": hidden, "mask": mask}
    return value.view(np.ndarray)


_BASES: Final[dict[type, Callable[[Any], object]]] = {
    dict: dict.copy,
    list: list.copy,
    tuple: lambda value: tuple(tuple.__iter__(value)),
    set: lambda value: set(set.__iter__(value)),
    frozenset: lambda value: frozenset(frozenset.__iter__(value)),
    str: str.__str__,
    int: int.__int__,
    float: float.__float__,
    bytes: lambda value: bytes(memoryview(value)),
    bytearray: lambda value: bytearray(memoryview(value)),
    complex: complex.__complex__,
    deque: lambda value: list(deque.__iter__(value)),
    MappingProxyType: dict,
}
