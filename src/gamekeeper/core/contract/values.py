"""Reading one value of a contract: of its kind, or an error that says what it should have been."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from numbers import Integral
from typing import Final, TypeVar

from gamekeeper.core.contract.failure import Failure
from gamekeeper.core.contract.parts import NONE, Plain, frozen
from gamekeeper.core.contract.places import Place, nearest, shown
from gamekeeper.errors import ContractError

T = TypeVar("T")
Read = Callable[[object, Place], T]

CHECK_ID: Final = re.compile(r"[A-Z]{2,8}\d{3,4}")
MASK: Final = re.compile(r"(infos|observation)(\.[^.\s]+)+")
MAX_DEPTH: Final = 16
"""Levels of lists and tables in a noop or an ideal value."""


def can_be_told(name: str) -> bool:
    """The text isn't blank, and any file can hold it."""
    return bool(name.strip()) and not any("\ud800" <= char <= "\udfff" for char in name)


def text(value: object, at: Place) -> str:
    """The value as text that any file can hold.

    Raises:
        ContractError: it is something else, empty, or holds half of a surrogate pair.
    """
    if not isinstance(value, str):
        raise at.error(
            f"'{at.text}' is not text",
            expected="text in quotes",
            seen=value,
            mend="put it in quotes",
        )
    if not can_be_told(value):
        raise at.error(
            f"'{at.text}' says nothing that can be read",
            expected="text of at least one letter",
            seen=value,
            mend="say it, or leave the key out",
        )
    return str(value)


def truth(value: object, at: Place) -> bool:
    """The value as true or false."""
    if isinstance(value, bool):
        return value
    mend = "write it without quotes" if value in ("true", "false") else "write true or false"
    raise at.error(
        f"'{at.text}' is not a truth value", expected="true or false", seen=value, mend=mend
    )


def whole(least: int) -> Read[int]:
    """Reads whole numbers from `least` on that fit into 64 bits."""

    def read(value: object, at: Place) -> int:
        if not isinstance(value, bool) and isinstance(value, Integral):
            number = int(value)
            if least <= number < 2**63:
                return number
        raise at.error(
            f"'{at.text}' is not a whole number from {least} on",
            expected=f"a whole number, at least {least}",
            seen=value,
            mend=f"write a whole number from {least} on, or leave the key out",
        )

    return read


def word(*allowed: str) -> Read[str]:
    """Reads one of the allowed words."""

    def read(value: object, at: Place) -> str:
        if isinstance(value, str) and value in allowed:
            return str(value)
        raise at.unknown(f"'{at.text}' can't be {shown(value)}", value, allowed, noun="word")

    return read


def listed(item: Read[T], *, least: int = 0) -> Read[tuple[T, ...]]:
    """Reads lists with at least `least` items."""

    def read(value: object, at: Place) -> tuple[T, ...]:
        if not isinstance(value, list | tuple) or len(value) < least:
            raise at.error(
                f"'{at.text}' is not a list" + (f" of {least} or more" if least else ""),
                expected="a list in square brackets" + (f", {least} or more" if least else ""),
                seen=value,
                mend="put the items into [ ]" if not isinstance(value, list | tuple) else "fill it",
            )
        return tuple(item(each, at / number) for number, each in enumerate(value))

    return read


def names(value: object, at: Place) -> tuple[str, ...]:
    """Reads one name, or a list of different names."""
    if isinstance(value, str):
        return (text(value, at),)
    return different(listed(text, least=1)(value, at), at)


def different(items: tuple[str, ...], at: Place) -> tuple[str, ...]:
    """The items, none of which stands twice.

    Raises:
        ContractError: one stands twice.
    """
    for number, item in enumerate(items):
        if item in items[:number]:
            raise (at / number).error(
                f"{item!r} stands twice in '{at.text}'",
                expected="each name once",
                seen=list(items),
                mend="leave the second out",
            )
    return items


def mask(value: object, at: Place) -> str:
    """Reads where a mask stands."""
    if isinstance(value, str) and (value == NONE or MASK.fullmatch(value)):
        return value
    usual = ("infos.action_mask", "observation.action_mask", NONE)
    near = nearest(value, usual)
    raise at.error(
        f"'{at.text}' doesn't say where the mask stands",
        expected='"infos.KEY", "observation.KEY", or "none"',
        seen=value,
        mend=f'write "{near or usual[0]}"',
    )


def anything(value: object, at: Place) -> Plain:
    """Reads any value that TOML and JSON both hold exactly."""
    try:
        _bounded(value, MAX_DEPTH)
        return frozen(value)
    except TypeError as error:
        raise at.error(
            f"'{at.text}' is not a plain value",
            expected="text, a finite number of 64 bits, true or false, or a list or table of them",
            seen=value,
            mend=f"replace {error}",
        ) from None


def _bounded(value: object, depth: int) -> None:
    if depth < 0:
        raise TypeError("what is nested so deeply")
    items = value.values() if isinstance(value, Mapping) else value
    if isinstance(value, Mapping | list | tuple):
        for item in items:  # type: ignore[attr-defined]
            _bounded(item, depth - 1)


def failure(value: object, at: Place) -> Failure:
    """Reads a condition."""
    written = text(value, at)
    try:
        return Failure(written)
    except ContractError as error:
        raise at.error(error.what, expected=error.expected, seen=written, mend=error.mend) from None


def waiver(value: object, at: Place) -> str:
    """Reads the reason of a waiver, whose key is the id of a check."""
    check = str(at.path[-1])
    if not CHECK_ID.fullmatch(check):
        upper = check.upper().replace("-", "").replace("_", "")
        right = CHECK_ID.fullmatch(upper)
        raise at.error(
            f"{check!r} is not the id of a check",
            expected="capital letters and a number of three or four digits, as GK402",
            seen=check,
            mend=f"write {upper}" if right else "take the id from the audit's report",
        )
    if not isinstance(value, str) or not value.strip():
        raise at.error(
            f"{check} is waived without a reason",
            expected="the reason as text",
            seen=value,
            mend=f'write why it is so on purpose: {check} = "…"',
        )
    return text(value, at)
