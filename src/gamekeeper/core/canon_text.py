"""JSON text of plain values, as UTF-8 can carry it."""

from __future__ import annotations

import json.encoder
import re
from base64 import b64encode
from collections.abc import Callable
from typing import Any, Final

_SURROGATE: Final = re.compile("[\ud800-\udfff]")
_PAIR: Final = re.compile("[\ud800-\udbff][\udc00-\udfff]")


def _encoder() -> Callable[[object], str]:
    """One encoder for all calls: `JSONEncoder.encode` makes a new one each time, which costs as much again."""
    plain = json.encoder.JSONEncoder(
        ensure_ascii=False,
        allow_nan=False,
        sort_keys=True,
        separators=(",", ":"),
        default=lambda value: value.item(),  # np.bool_, np.int64
    )
    make = getattr(json.encoder, "c_make_encoder", None)
    if make is None:  # not CPython
        return plain.encode
    string: Any = json.encoder.encode_basestring
    encode = make(None, plain.default, string, None, ":", ",", True, False, False)
    return lambda value: "".join(encode(value, 0))


encode: Final = _encoder()
"""JSON of plain values in one order of keys; ValueError where a float isn't finite or an int too long."""


def escaped(text: str) -> str | None:
    """A JSON text that UTF-8 can carry; None where two surrogates would melt into one character on reading."""
    if text.isascii():
        return text
    if _PAIR.search(text):
        return None
    return _SURROGATE.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def string(value: str) -> str:
    """The JSON of a text; an object with its bytes where two surrogates would melt into one character."""
    text = escaped(json.encoder.encode_basestring(value))
    if text is None:
        return tagged("str", base64(value.encode("utf-8", "surrogatepass")))
    return text


def clean(text: str) -> str:
    """Text that UTF-8 can carry, for names and reprs, which nobody reads back."""
    return text if text.isascii() else text.encode("utf-8", "backslashreplace").decode()


def base64(value: bytes | bytearray) -> str:
    """The JSON of bytes."""
    return f'"{b64encode(value).decode()}"'


def tagged(kind: str, text: str) -> str:
    """An object of a kind with its value, of which the JSON is given."""
    return f'{{"$":"{kind}","v":{text}}}'
