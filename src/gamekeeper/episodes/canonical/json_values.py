"""Values into canonical JSON, and back; the forms stand in the package's docstring.

Reading runs no code and imports no name from a text.
"""

import json
import math
import re
from base64 import b64decode
from collections.abc import Callable, Collection, Sequence
from typing import Any, Final

import numpy as np
from gymnasium.spaces import GraphInstance

from gamekeeper.episodes.canonical.arrays import (
    SCALARS,
    array_text,
    number,
    read_array,
    read_record,
    read_scalar,
    scalar_text,
)
from gamekeeper.episodes.canonical.json_text import (
    base64,
    encode,
    escaped,
    number_text,
    string,
    tagged,
)
from gamekeeper.episodes.canonical.opaque import Opaque, content_of, shown, type_name
from gamekeeper.episodes.plain_json import is_damage, is_misshapen
from gamekeeper.errors import EvidenceError

# -- Writing

_DEPTH: Final = 64  # containers within containers
_CONTAINERS: Final = 1_000_000  # in one value; parts that share parts can be exponentially many
_INT_BITS: Final = 2_000  # 603 digits: CPython's limit for texts of ints can be set down to 640

# What json's encoder in C writes rightly as an element of a list or a value of a dict.
_FLAT: Final = frozenset(
    {type(None), bool, int, float, str, np.bool_, np.int64, np.float64, np.str_}
)
_NAMES: Final = frozenset({str})
_TEXTS: Final = frozenset({str, np.str_})


def to_json(value: object) -> str:
    """The canonical JSON text of any value; never raises.

    A container that lies within itself, within 64 others, or behind a million others is written as
    an object that says so.
    """
    try:
        if type(value) is dict:
            if not value:
                return "{}"
            for key, item in value.items():
                if type(item) not in _FLAT or type(key) is not str or key == "$":
                    break
            else:
                text = _flat(value, value.values())
                if text is not None:
                    return text
        return _write(value, _JsonWalk())
    except RecursionError:  # the caller's own stack was nearly full
        return _object(value, "<no room on the stack>")
    except KeyboardInterrupt:
        raise
    except BaseException:  # of a class whose own class is foreign code
        return _object(value, "<raises when it is looked at>")


class _JsonWalk:
    """Position of the writer: the containers around it, and how many more it may enter."""

    __slots__ = ("around", "left")

    def __init__(self) -> None:
        self.around: set[int] = set()
        self.left = _CONTAINERS


def _write(value: object, walk: _JsonWalk) -> str:
    """The text of one value: leaves by their exact type, containers guarded."""
    leaf = _LEAVES.get(type(value))
    if leaf is not None:
        return leaf(value)
    key = id(value)
    if key in walk.around:
        return _object(value, "<within itself>")
    if len(walk.around) >= _DEPTH:
        return _object(value, f"<within {_DEPTH} others>")
    if walk.left <= 0:
        return _object(value, f"<behind {_CONTAINERS} others>")
    walk.left -= 1
    walk.around.add(key)
    text = _CONTAINED.get(type(value), _other)(value, walk)
    walk.around.remove(key)
    return text


def _flat(value: object, items: Collection[object]) -> str | None:
    """The text of a container of `_FLAT` items; None where one of them isn't so plain after all."""
    try:
        text = encode(value)
    except ValueError:  # not finite, or an int too long
        return None
    if len(text) > _INT_BITS // 4 and any(
        type(item) is int and item.bit_length() > _INT_BITS for item in items
    ):
        return None
    return text if text.isascii() else escaped(text)


def _int(value: int) -> str:
    return tagged("int", f'"{value:#x}"') if value.bit_length() > _INT_BITS else repr(value)


def _float(value: float) -> str:
    if value - value == 0.0:
        return repr(value)
    kind = "nan" if value != value else "inf" if value > 0 else "-inf"
    return f'{{"$":"{kind}"}}'


def _opaque(value: Opaque) -> str:
    name = string(value.type)
    if value.content is not None:
        return f'{{"$":"object","type":{name},"v":{value.content}}}'
    return f'{{"$":"object","repr":{string(value.repr)},"type":{name}}}'


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
    range: lambda value: tagged(
        "range", f"[{_int(value.start)},{_int(value.stop)},{_int(value.step)}]"
    ),
    Opaque: _opaque,
}


def _sequence(value: Sequence[object], walk: _JsonWalk) -> str:
    if _FLAT.issuperset(map(type, value)):
        text = _flat(value, value)
        if text is not None:
            return text
    return "[" + ",".join([_write(item, walk) for item in value]) + "]"


def _set(value: Collection[object], walk: _JsonWalk) -> str:
    return "[" + ",".join(sorted([_write(item, walk) for item in value])) + "]"


def _dict(value: dict[Any, object], walk: _JsonWalk) -> str:
    if not _NAMES.issuperset(map(type, value)):
        if not _TEXTS.issuperset(map(type, value)):
            return _pairs(value, walk)
        value = {str.__str__(key): item for key, item in value.items()}
    if "$" in value:
        return _pairs(value, walk)
    fields = []
    for name in sorted(value):
        text = string(name)
        if text[0] != '"':
            return _pairs(value, walk)
        fields.append(f"{text}:{_write(value[name], walk)}")
    return "{" + ",".join(fields) + "}"


def _pairs(value: dict[Any, object], walk: _JsonWalk) -> str:
    pairs = sorted([(_write(key, walk), _write(item, walk)) for key, item in value.items()])
    return tagged("dict", "[" + ",".join([f"[{key},{item}]" for key, item in pairs]) + "]")


def _array(value: np.ndarray[Any, Any], walk: _JsonWalk) -> str:
    text = array_text(value, lambda item: _write(item, walk))
    return _object(value, shown(value)) if text is None else text


_CONTAINED: Final[dict[type, Callable[[Any, _JsonWalk], str]]] = {
    list: _sequence,
    tuple: lambda value, walk: tagged("tuple", _sequence(value, walk)),
    dict: _dict,
    set: lambda value, walk: tagged("set", _set(value, walk)),
    frozenset: lambda value, walk: tagged("frozenset", _set(value, walk)),
    np.ndarray: _array,
    GraphInstance: lambda value, walk: tagged("GraphInstance", _sequence(tuple(value), walk)),
}


def _other(value: object, walk: _JsonWalk) -> str:
    """The text of what is no builtin: numpy's scalars, a known content, or a repr."""
    try:
        if isinstance(value, np.generic) and type(value) is value.dtype.type:
            text = scalar_text(value, lambda item: _write(item, walk))
            if text is not None:
                return text
        content = content_of(value)
    except KeyboardInterrupt:
        raise
    except BaseException:  # attributes of foreign classes may do anything
        content = None
    if content is None:
        return _object(value, shown(value))
    return _opaque(Opaque(type_name(value), content=_write(content, walk)))


# -- Reading

_NESTING: Final = 512  # brackets; `to_json` nests 64 containers of at most four
_TOKEN: Final = re.compile(r'"(?:[^"\\]|\\.)*"|[\[\]{}]', re.DOTALL)

Fields = dict[str, Any]


def from_json(text: str) -> object:
    """The value that a canonical text was written from.

    Builtins and numpy come back equal and of the same types (`np.bool_`, `np.int64`, `np.float64`
    and `np.str_` as bool, int, float and str), all else as an `Opaque`.

    Raises:
        EvidenceError: the text isn't JSON, is nested too deeply, or has an object that `to_json`
            doesn't write.
    """
    try:
        if text.count("[") + text.count("{") > _NESTING and _nesting(text) > _NESTING:
            raise ValueError(f"nested deeper than {_NESTING}")
        return _DECODER.decode(text)
    except EvidenceError:
        raise
    except Exception as error:
        if not (is_damage(error) or is_misshapen(error)):
            raise
        raise EvidenceError(
            "a value's JSON can't be read",
            expected="canonical JSON as gamekeeper writes it",
            actual=f"{str(text)[:80]!r}: {type(error).__name__}: {error}",
            fix="the text was cut or changed: take it from the recording again",
        ) from error


def _nesting(text: str) -> int:
    """The deepest nesting of brackets outside strings."""
    depth = deepest = 0
    for token in _TOKEN.finditer(text):
        first = text[token.start()]
        if first in "[{":
            depth += 1
            deepest = max(deepest, depth)
        elif first != '"':
            depth -= 1
    return deepest


def _read(fields: Fields) -> object:
    """The value of one JSON object; what is within it has been read already."""
    if "$" not in fields:
        return fields
    kind = fields["$"]
    return read_scalar(kind, fields["v"]) if kind in SCALARS else _KINDS[kind](fields)


def _read_opaque(fields: Fields) -> Opaque:
    name, words = fields["type"], fields.get("repr", "")
    if not isinstance(name, str) or not isinstance(words, str):
        raise TypeError("type and repr are text")
    return Opaque(name, words, to_json(fields["v"]) if "v" in fields else None)


def _scalar(fields: Fields) -> object:
    array = fields["v"]
    if not isinstance(array, np.ndarray) or array.shape != ():
        raise TypeError("a scalar is an array of no dimensions")
    return array[()]


def _bytes(fields: Fields) -> bytes:
    return b64decode(fields["v"], validate=True)


def _items(fields: Fields) -> list[Any]:
    items = fields["v"]
    if type(items) is not list:
        raise TypeError("elements stand in a list")
    return items


def _refuse(word: str) -> object:
    raise ValueError(f"{word} isn't JSON")


_KINDS: Final[dict[str, Callable[[Fields], object]]] = {
    "nan": lambda fields: math.nan,
    "inf": lambda fields: math.inf,
    "-inf": lambda fields: -math.inf,
    "int": lambda fields: int(fields["v"], 16),
    "str": lambda fields: _bytes(fields).decode("utf-8", "surrogatepass"),
    "tuple": lambda fields: tuple(_items(fields)),
    "set": lambda fields: set(_items(fields)),
    "frozenset": lambda fields: frozenset(_items(fields)),
    "dict": lambda fields: dict(_items(fields)),
    "bytes": _bytes,
    "bytearray": lambda fields: bytearray(_bytes(fields)),
    "bytes_": lambda fields: np.bytes_(_bytes(fields)),
    "complex": lambda fields: complex(*map(number, _items(fields))),
    "range": lambda fields: range(*_items(fields)),
    "scalar": _scalar,
    "ndarray": lambda fields: read_array(fields["dtype"], fields["shape"], fields["v"]),
    "record": lambda fields: read_record(fields["shape"], _items(fields)),
    "GraphInstance": lambda fields: GraphInstance(*_items(fields)),
    "object": _read_opaque,
}

_DECODER: Final = json.JSONDecoder(object_hook=_read, parse_constant=_refuse)
