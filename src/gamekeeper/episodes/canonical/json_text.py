"""JSON text of plain values, such that UTF-8 can carry it."""

import json.encoder
import math
import re
from base64 import b64encode
from collections.abc import Callable, Sequence
from typing import Final

_SURROGATE: Final = re.compile("[\ud800-\udfff]")
_PAIR: Final = re.compile("[\ud800-\udbff][\udc00-\udfff]")


def _encoder() -> Callable[[object], str]:
    """One encoder for all calls; `JSONEncoder.encode` makes a new one each time."""
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
    write = make(
        None, plain.default, json.encoder.encode_basestring, None, ":", ",", True, False, False
    )
    return lambda value: "".join(write(value, 0))


encode: Final = _encoder()
"""JSON of plain values, keys sorted; ValueError where a float isn't finite or an int too long."""


def number_text(numbers: Sequence[object]) -> str:
    """A list of numbers as JSON, with "nan", "inf" and "-inf" for what JSON doesn't know."""
    try:
        return encode(numbers)
    except ValueError:
        return encode([_word(number) for number in numbers])


def _word(number: object) -> object:
    if isinstance(number, float) and not math.isfinite(number):
        return "nan" if math.isnan(number) else "inf" if number > 0 else "-inf"
    return number


def escaped(text: str) -> str | None:
    """A JSON text without surrogates; None where two of them would be read as one character."""
    if text.isascii():
        return text
    if _PAIR.search(text):
        return None
    return _SURROGATE.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def string(value: str) -> str:
    """The JSON of a text; an object with its bytes where `escaped` has no answer."""
    text = escaped(json.encoder.encode_basestring(value))
    return tagged("str", base64(value.encode("utf-8", "surrogatepass"))) if text is None else text


def clean(text: str) -> str:
    """Text that UTF-8 can carry, for names and reprs, which aren't read back."""
    return text if text.isascii() else text.encode("utf-8", "backslashreplace").decode()


def base64(value: bytes | bytearray) -> str:
    """The JSON of bytes."""
    return f'"{b64encode(value).decode()}"'


def tagged(kind: str, text: str) -> str:
    """An object of a kind, with the JSON of its value."""
    return f'{{"$":"{kind}","v":{text}}}'
