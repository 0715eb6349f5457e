"""Damage: bits and pieces of bytes, values of plain data, and words that parsers trip over."""

import random
from collections.abc import Sequence
from typing import Any, Final

WORDS: Final = [
    b"",
    b"\0",
    b"\n",
    b"-1",
    b"0",
    b"1e999",
    b"NaN",
    b"null",
    b"true",
    b"[[[[[[[[",
    b"{" * 64,
    b"..",
    b"/",
    b"../../x",
    b"C:\\x",
    b"\xff\xfe",
    b"\xe2\x80\xae",
    b"9" * 40,
    b'"',
    b"'",
    b"\\u0000",
    b"PAR1",
    b"ARROW1",
    (2**31 - 1).to_bytes(4, "little"),
    (2**63 - 1).to_bytes(8, "little"),
    b"\xff" * 8,
    b"\x80" * 16,
    b"\x1b]0;x\x07",
    b"<script>",
    b"\\ud800",
    b"con",
    b"[" * 3000,
    b'{"":' * 3000,
    b"a." * 3000,
]
VALUES: Final[list[Any]] = [
    None,
    True,
    False,
    0,
    -1,
    1,
    2**31,
    2**63,
    10**40,
    0.5,
    -0.0,
    1e308,
    "",
    "x",
    "..",
    "../../x",
    "/etc/passwd",
    "C:\\x",
    "a\0b",
    "\ud800",
    "\u202ex",
    "\x1b[2J",
    "<script>",
    "9" * 5000,
    [],
    {},
    [[]],
    [None],
    {"": None},
    [{}],
    ["x", 1],
    {"x": {"y": [1]}},
]
"""Put in the place of a value of plain data; JSON and Python both hold them."""
DEPTH: Final = 150


def damaged(data: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    """One to four damages, one after the other."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        at = rng.randrange(len(out) + 1)
        size = min(rng.choice((1, 2, 4, 8, 64, 1000)), max(len(out) - at, 0))
        kind = rng.randrange(7)
        if kind == 0 and at < len(out):
            out[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            out[at : at + size] = b""
        elif kind == 2:
            out[at:at] = out[at : at + size]
        elif kind == 3:
            out[at : at + size] = rng.choice(WORDS)
        elif kind == 4:
            other = rng.choice(others)
            start = rng.randrange(len(other) + 1)
            out[at : at + size] = other[start : start + size]
        elif kind == 5:
            del out[at:]
        else:
            out[at : at + size] = rng.randbytes(size)
    return bytes(out)


def altered(value: Any, rng: random.Random) -> Any:
    """Plain data with one to three of its values, keys or lengths changed."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        value = _altered(value, rng)
    return value


def _altered(value: Any, rng: random.Random) -> Any:
    inner: list[Any] = list(value) if isinstance(value, dict | list) and value else []
    if not inner or rng.random() < 0.15:
        return _other(value, rng)
    if isinstance(value, dict):
        key = rng.choice(inner)
        rest = dict(value)
        kind = rng.randrange(10)
        if kind == 0:
            del rest[key]
        elif kind == 1:
            rest[str(rng.choice(VALUES))[:50]] = rest.pop(key)
        else:
            rest[key] = _altered(value[key], rng)
        return rest
    place = rng.randrange(len(inner))
    kind = rng.randrange(10)
    if kind == 0:
        del inner[place]
    elif kind == 1:
        inner.insert(place, inner[place])
    else:
        inner[place] = _altered(inner[place], rng)
    return inner


def _other(value: Any, rng: random.Random) -> Any:
    """Another value in its place: of another kind, near it, or deep."""
    kind = rng.randrange(8)
    if kind == 0 and isinstance(value, int | float):
        return value + rng.choice((-1, 1, 0.5, 2**40))
    if kind == 1 and isinstance(value, str):
        return value + rng.choice(("x", "\0", "/", " ", "\n", '"""', "*"))
    if kind == 2:
        for _ in range(rng.choice((3, DEPTH))):
            value = rng.choice(([value], {"x": value}))
        return value
    return rng.choice(VALUES)
