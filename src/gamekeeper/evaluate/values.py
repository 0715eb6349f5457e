"""Reading one value of a specification: of its kind, or an error that names its place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gamekeeper.core.contract.places import nearest, path_text, shown
from gamekeeper.errors import SpecError


class Place:
    """Where in a specification a value stands, for errors that say so."""

    def __init__(self, source: str, path: tuple[str | int, ...] = ()) -> None:
        self.source, self.path = source, path

    def __truediv__(self, key: str | int) -> Place:
        return Place(self.source, (*self.path, key))

    def error(self, what: str, *, expected: str, seen: object, mend: str = "") -> SpecError:
        """An error that names this place."""
        where = ", ".join(part for part in (self.source, path_text(self.path)) if part)
        return SpecError(what, where=where, expected=expected, seen=shown(seen), mend=mend)

    def wrong(self, value: object, expected: str) -> SpecError:
        """An error for a value that isn't of its key's kind."""
        return self.error(f"'{path_text(self.path)}' can't be read", expected=expected, seen=value)


def table(value: object, at: Place, known: tuple[str, ...] | None = None) -> Mapping[str, Any]:
    """The value as a table, with known keys alone where they are given.

    Raises:
        SpecError: it is something else, or has another key.
    """
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise at.wrong(value, "a table of names and values")
    for key in value if known is not None else ():
        if key not in (known or ()):
            near = nearest(key, known or ())
            inside = f"in [{path_text(at.path)}]" if at.path else "at the top"
            raise (at / key).error(
                f"{key!r} is no key {inside} of a specification", expected=", ".join(known or ()),
                seen=key, mend=f"write '{near}'" if near else "leave it out",
            )  # fmt: skip
    return value


def text(value: object, at: Place) -> str:
    """The value as a text that says something."""
    if not isinstance(value, str) or not value.strip():
        raise at.wrong(value, "text in quotes")
    return value


def texts(value: object, at: Place) -> tuple[str, ...]:
    """The value as a list of texts."""
    if not isinstance(value, list | tuple):
        raise at.wrong(value, "a list of texts")
    return tuple(text(each, at / place) for place, each in enumerate(value))


def word(value: object, at: Place, allowed: tuple[str, ...]) -> str:
    """The value as one of the allowed words."""
    if value not in allowed:
        near = nearest(value, allowed)
        raise at.error(
            f"'{path_text(at.path)}' can't be {shown(value)}", expected=" or ".join(allowed),
            seen=value, mend=f"write '{near}'" if near else "",
        )  # fmt: skip
    return str(value)


def whole(value: object, at: Place, least: int = 1) -> int:
    """The value as a whole number from `least` on."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise at.wrong(value, f"a whole number from {least} on")
    return value


def truth(value: object, at: Place) -> bool:
    """The value as true or false."""
    if not isinstance(value, bool):
        raise at.wrong(value, "true or false")
    return value


def number(value: object, at: Place, low: float, high: float) -> float:
    """The value as a number between two others."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not low < value < high:
        raise at.wrong(value, f"a number between {low:g} and {high:g}")
    return float(value)


def maybe(table: Mapping[str, Any], key: str, at: Place, read: Callable[[Any, Place], Any]) -> Any:
    """What stands under a key, read; None where nothing does."""
    return read(table[key], at / key) if key in table else None
