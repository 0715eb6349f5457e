"""Any Python value as one canonical JSON text, and back.

Plain values are plain JSON: None, bool, int, finite float, str, list, and dict with str keys; `np.bool_`, `np.int64`,
`np.float64` and `np.str_` are written as these on purpose, so that an info doesn't depend on int against `np.int64`.
Everything else is an object with a "$" that names its kind:

    {"$":"nan"} {"$":"inf"} {"$":"-inf"}                     floats that JSON doesn't know
    {"$":"int","v":"0x1f"}                                   an int beyond 2,000 bits
    {"$":"str","v":base64}                                   a str with a surrogate pair in two characters
    {"$":"tuple","v":[...]}  set  frozenset                  sets in the order of their elements' texts
    {"$":"dict","v":[[key, value], ...]}                     other keys, or a key "$"; in the order of their texts
    {"$":"bytes","v":base64}  bytearray  bytes_              bytes_: `np.bytes_`
    {"$":"complex","v":[re, im]}  {"$":"range","v":[0,9,1]}
    {"$":"float32","v":0.5}  int8  complex64 ...             numpy scalars; {"$":"scalar","v":<ndarray>} for rare ones
    {"$":"ndarray","dtype":"<f4","shape":[2],"v":[1.0,2.0]}  always little-endian; base64 beyond 64 elements
    {"$":"record","shape":[2],"v":[["x", <ndarray>], ...]}   structured arrays by field
    {"$":"GraphInstance","v":[nodes, edges, edge_links]}
    {"$":"object","type":"module.Class","repr":"..."}        anything else, addresses scrubbed
    {"$":"object","type":"module.Class","v":...}             ... whose content is known: subclasses of builtins, named
                                                             tuples, dataclasses, enums, subclasses of ndarray

Equal values of equal types have equal texts in every process, under every hash seed; there is one NaN, and -0.0 is kept.
Laws: `from_json(to_json(x))` equals x for builtins and numpy; `to_json(from_json(t)) == t` for every t that `to_json` wrote.
"""

from __future__ import annotations

import dataclasses
import re
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from enum import Enum
from types import MappingProxyType
from typing import Any, Final, cast

import numpy as np
from gymnasium.spaces import GraphInstance

from gamekeeper.core.canon_array import array_text, number_text, scalar_text
from gamekeeper.core.canon_read import Opaque, from_json
from gamekeeper.core.canon_text import base64, clean, encode, escaped, string, tagged

__all__ = ["Opaque", "drop", "from_json", "is_exact", "shown", "to_json", "type_name"]

_DEPTH: Final = 64  # containers within containers
_CONTAINERS: Final = 1_000_000  # in one value: small values that share their parts can be exponentially long
_REPR: Final = 200  # characters
_INT_BITS: Final = 2_000  # 603 digits: CPython's limit for int <-> str can be set down to 640
_ADDRESS: Final = re.compile(r"\bat 0x[0-9A-Fa-f]+|0x[0-9A-Fa-f]{8,}")

# What json's encoder in C writes as it should, where it stands in a list or as a value of a dict.
_FLAT: Final = frozenset(
    {type(None), bool, int, float, str, np.bool_, np.int64, np.float64, np.str_}
)


def to_json(value: object) -> str:
    """The canonical JSON text of any value; never raises.

    A value inside itself, deeper than 64 containers or after the first million containers is written as an object that
    says so.
    """
    if type(value) is dict and "$" not in value:
        if not value:
            return "{}"
        for key, item in value.items():
            if type(key) is not str or type(item) not in _FLAT:
                break
        else:
            text = _flat(value, value.values())
            if text is not None:
                return text
    return _write(value, _Walk())


def is_exact(text: str) -> bool:
    """Whether `from_json` gives back all of the value that this canonical text was written from."""
    return '"$":"object"' not in text  # inside a JSON string the quotes would have backslashes


def drop(info: Mapping[str, object], names: Collection[str]) -> dict[str, object]:
    """The info without the fields of these names."""
    return {key: value for key, value in info.items() if key not in names}


def type_name(value: object) -> str:
    """The name of a value's type as a reader knows it: `list`, `numpy.float32`, `module.Class`."""
    if type(value) is Opaque:
        return value.type
    cls = type(value)
    try:
        module, name = str(cls.__module__), str(cls.__qualname__)
    except Exception:  # a metaclass may do anything
        return "object"
    return clean(name if module == "builtins" else f"{module}.{name}")


def shown(value: object) -> str:
    """The repr of a value without the addresses in it, at most 200 characters."""
    try:
        text = repr(value)
    except Exception:  # foreign code
        text = "<repr raises>"
    text = _ADDRESS.sub("at 0x?", clean(text[: 20 * _REPR]))
    return text if len(text) <= _REPR else text[: _REPR - 1] + "…"


class _Walk:
    """Where the writer is: the containers around it, and how many more it may enter."""

    __slots__ = ("around", "left")

    def __init__(self) -> None:
        self.around: set[int] = set()
        self.left = _CONTAINERS


def _write(value: object, walk: _Walk) -> str:
    """The text of one value; leaves by their exact type, containers guarded against cycles, depth and number."""
    leaf = _LEAVES.get(type(value))
    if leaf is not None:
        return leaf(value)
    inside = _CONTENTS.get(type(value), _other)
    key = id(value)
    if key in walk.around:
        return _object(value, "<inside itself>")
    if len(walk.around) >= _DEPTH:
        return _object(value, f"<deeper than {_DEPTH}>")
    if walk.left <= 0:
        return _object(value, f"<after {_CONTAINERS} containers>")
    walk.left -= 1
    walk.around.add(key)
    text = inside(value, walk)
    walk.around.remove(key)
    return text


# Leaves


def _flat(value: object, items: Iterable[object]) -> str | None:
    """The text of a list, tuple or str-keyed dict of plain values; None where one of them isn't so plain."""
    try:
        text = encode(value)
    except ValueError:  # not finite, or an int too long
        return None
    if len(text) > _INT_BITS // 4 and any(
        type(item) is int and item.bit_length() > _INT_BITS for item in items
    ):
        return None
    return escaped(text)


def _int(value: int) -> str:
    if value.bit_length() > _INT_BITS:
        return tagged("int", f'"{value:#x}"')
    return repr(value)


def _float(value: float) -> str:
    if value - value == 0.0:
        return repr(value)
    return '{"$":"nan"}' if value != value else '{"$":"inf"}' if value > 0 else '{"$":"-inf"}'


def _opaque(value: Opaque) -> str:
    if value.content is not None:
        return f'{{"$":"object","type":{string(value.type)},"v":{value.content}}}'
    return f'{{"$":"object","repr":{string(value.repr)},"type":{string(value.type)}}}'


def _object(value: object, words: str) -> str:
    return _opaque(Opaque(type_name(value), words))


_LEAVES: Final[dict[type, Callable[[Any], str]]] = {
    type(None): lambda value: "null",
    bool: lambda value: "true" if value else "false",
    np.bool_: lambda value: "true" if value else "false",
    int: _int,
    np.int64: lambda value: repr(int(value)),
    float: _float,
    np.float64: lambda value: _float(float(value)),
    str: string,
    np.str_: lambda value: string(str.__str__(value)),
    bytes: lambda value: tagged("bytes", base64(value)),
    bytearray: lambda value: tagged("bytearray", base64(value)),
    np.bytes_: lambda value: tagged("bytes_", base64(value)),
    complex: lambda value: tagged("complex", number_text([value.real, value.imag])),
    range: lambda value: tagged("range", _sequence([value.start, value.stop, value.step], _Walk())),
    Opaque: _opaque,
}


# Containers


def _sequence(value: Sequence[object], walk: _Walk) -> str:
    if _FLAT.issuperset(map(type, value)):
        text = _flat(value, value)
        if text is not None:
            return text
    return "[" + ",".join([_write(item, walk) for item in value]) + "]"


def _set(value: Collection[object], walk: _Walk) -> str:
    return "[" + ",".join(sorted([_write(item, walk) for item in value])) + "]"


def _dict(value: dict[object, object], walk: _Walk) -> str:
    if "$" in value or not all(
        type(key) is str or (type(key) is np.str_) for key in value
    ):
        return _pairs(value, walk)
    names = {str.__str__(cast("str", key)): item for key, item in value.items()}
    if _FLAT.issuperset(map(type, names.values())):
        text = _flat(names, names.values())
        if text is not None:
            return text
    fields = [(string(name), names[name]) for name in sorted(names)]
    if any(text[0] != '"' for text, _ in fields):
        return _pairs(value, walk)
    return "{" + ",".join([f"{text}:{_write(item, walk)}" for text, item in fields]) + "}"


def _pairs(value: dict[object, object], walk: _Walk) -> str:
    pairs = [(_write(key, walk), _write(item, walk)) for key, item in value.items()]
    return tagged("dict", "[" + ",".join([f"[{key},{item}]" for key, item in sorted(pairs)]) + "]")


def _array(value: np.ndarray[Any, Any], walk: _Walk) -> str:
    text = array_text(value, lambda item: _write(item, walk))
    return _shown(value) if text is None else text


_CONTENTS: Final[dict[type, Callable[[Any, _Walk], str]]] = {
    list: _sequence,
    tuple: lambda value, walk: tagged("tuple", _sequence(value, walk)),
    dict: _dict,
    set: lambda value, walk: tagged("set", _set(value, walk)),
    frozenset: lambda value, walk: tagged("frozenset", _set(value, walk)),
    np.ndarray: _array,
    GraphInstance: lambda value, walk: tagged("GraphInstance", _sequence(tuple(value), walk)),
}

# The builtin part of an instance of a subclass, taken without running any code of the subclass.
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
    complex: lambda value: complex.__add__(value, 0j),
    deque: lambda value: list(deque.__iter__(value)),
    MappingProxyType: dict,
}


def _other(value: object, walk: _Walk) -> str:
    """The text of what is neither a builtin nor an array: its content where that is known, its repr otherwise."""
    if isinstance(value, np.generic):
        text = scalar_text(value, lambda item: _write(item, walk))
        if text is not None:
            return text
    try:
        content = _content(value)
    except Exception:  # attributes of foreign classes may do anything
        return _shown(value)
    if content is None:
        return _shown(value)
    return _opaque(Opaque(type_name(value), content=_write(content, walk)))


def _content(value: object) -> object:
    """What an instance of a known family holds, as plainer values; None for all others."""
    if isinstance(value, Enum):
        return {"name": value._name_, "value": value._value_}
    if isinstance(value, np.ma.MaskedArray):
        mask = np.ma.getmaskarray(value)
        return {"data": np.where(mask, np.zeros((), value.dtype), value.data), "mask": mask}
    if isinstance(value, np.ndarray):
        return value.view(np.ndarray)
    if isinstance(value, tuple) and hasattr(type(value), "_fields"):
        return dict(zip(type(value)._fields, tuple.__iter__(value), strict=True))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    for base, plain in _BASES.items():
        if isinstance(value, base):
            return plain(value)
    return None


def _shown(value: object) -> str:
    return _object(value, shown(value))
