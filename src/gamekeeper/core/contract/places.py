"""Where a declaration stands in the text it came from, and errors that say so."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from reprlib import Repr
from typing import Final

from gamekeeper.errors import ContractError

Path = tuple[str | int, ...]
"""Keys and list indices from the root, as in ("schedule", "stages", 0, 1)."""

BARE: Final = re.compile(r"[A-Za-z0-9_-]+")
SEEN_CHARS: Final = 80
"""The longest a value is shown in an error."""


def path_text(path: Path) -> str:
    """The path as a reader types it: `schedule.stages[0][1]`, quotes where TOML needs them."""
    text = ""
    for key in path:
        if isinstance(key, int):
            text += f"[{key}]"
        else:
            name = key if BARE.fullmatch(key) else json.dumps(key, ensure_ascii=False)
            text += f".{name}" if text else name
    return text


def one_line(text: str) -> str:
    """The text on one line with every control character made visible, so no terminal obeys it."""
    line = " ".join(text.split())
    return "".join(char if char.isprintable() else f"\\u{ord(char):04x}" for char in line)


def nearest(word: object, known: Iterable[str]) -> str | None:
    """The known word that the given one was probably meant to be."""
    options = list(known)
    lower = {option.lower(): option for option in options}
    close = get_close_matches(str(word).lower(), lower, n=1)
    return lower[close[0]] if close else None


def shown(value: object) -> str:
    """The value as text for an error, cut where it is long, wide or deep."""
    if isinstance(value, bool):
        return str(value).lower()
    short = Repr()
    short.maxlevel, short.maxlist, short.maxdict = 4, 12, 12
    short.maxstring = short.maxlong = short.maxother = 2 * SEEN_CHARS
    text = short.repr(value)
    return text if len(text) <= SEEN_CHARS else text[: SEEN_CHARS - 1] + "…"


@dataclass(frozen=True, slots=True)
class Places:
    """The lines of a text where its keys and list items stand.

    Args:
        source: name of the text, as a reader finds it: a file, `<text>`, a bundle.
        lines: the line of each path, counted from 1.
    """

    source: str = ""
    lines: Mapping[Path, int] = field(default_factory=dict)

    def line(self, path: Path) -> int | None:
        """The line of the path, or of what is nearest above it in the tree."""
        for length in range(len(path), 0, -1):
            if path[:length] in self.lines:
                return self.lines[path[:length]]
        return None

    def at(self, path: Path) -> str:
        """Names source, line and key path: `warehouse.toml, line 12, roles.picker.noop`."""
        line = self.line(path)
        parts = [self.source, f"line {line}" if line else "", path_text(path)]
        return ", ".join(part for part in parts if part)


@dataclass(frozen=True, slots=True)
class Place:
    """One path in a text: what readers of a value are handed, to say where it was wrong."""

    places: Places
    path: Path = ()

    def __truediv__(self, key: str | int) -> Place:
        return Place(self.places, (*self.path, key))

    @property
    def text(self) -> str:
        """The key path alone."""
        return path_text(self.path)

    def error(self, what: str, *, expected: str, seen: object, mend: str) -> ContractError:
        """An error that names this place; `seen` is shown as a value, cut where it is long."""
        where = self.places.at(self.path)
        return ContractError(what, where=where, expected=expected, seen=shown(seen), mend=mend)

    def unknown(self, what: str, word: object, known: Iterable[str], *, noun: str) -> ContractError:
        """An error for a word that isn't among the known ones, with the nearest as its mend."""
        options = list(known)
        near = nearest(word, options)
        listed = ", ".join(repr(option) for option in options) or f"none: no {noun} is declared"
        mend = f"write '{near}'" if near else f"use one of the {noun}s that are listed"
        if not options:
            mend = f"declare the {noun} first, or leave this out"
        return self.error(what, expected=listed, seen=word, mend=mend)

    def table(self, value: object) -> Mapping[str, object]:
        """The value as a table with text for keys.

        Raises:
            ContractError: it is something else.
        """
        if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
            return value
        raise self.error(
            f"'{self.text or 'the contract'}' is not a table",
            expected="a table of names and values",
            seen=value,
            mend=f"write a section [{self.text or 'roles.picker'}] with its keys below",
        )


NOWHERE: Final = Places()
"""The places of what never was a text."""
