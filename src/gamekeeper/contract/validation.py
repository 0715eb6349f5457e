"""Validation of what people write: typed readers for values, and errors that say where and why.

A reader takes a plain value and its place, and returns the value as its type or raises. `section`
makes one of a class out of readers by key; contracts and specifications are declared with it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from numbers import Integral
from reprlib import Repr
from typing import Final, TypeAlias, TypeVar

from gamekeeper.contract.sections import Table
from gamekeeper.errors import ContractError, GamekeeperError

T = TypeVar("T")

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
class SourceLines:
    """The lines of a text where its keys and list items stand.

    Args:
        source: name of the text, as a reader finds it: a file, `<text>`, a run.
        lines: the line of each path, counted from 1.
        document: what the text is, as errors call it.
        refusal: class of the errors.
    """

    source: str = ""
    lines: Mapping[Path, int] = field(default_factory=dict)
    document: str = "contract"
    refusal: type[GamekeeperError] = ContractError

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
class SourcePath:
    """One path in a text: what readers of a value are handed, to say where it was wrong.

    Args:
        places: lines of the text.
        path: keys and indices.
        mistakes: where errors are collected, so that all are reported together; None: the first
            one is raised.
    """

    places: SourceLines
    path: Path = ()
    mistakes: list[GamekeeperError] | None = None

    def __truediv__(self, key: str | int) -> SourcePath:
        return SourcePath(self.places, (*self.path, key), self.mistakes)

    def report(self, error: GamekeeperError) -> None:
        """Collects the error, or raises it where errors aren't collected."""
        if self.mistakes is None:
            raise error
        self.mistakes.append(error)

    @contextmanager
    def collecting(self) -> Iterator[None]:
        """Reports an error of the block and goes on after it."""
        try:
            yield
        except GamekeeperError as error:
            self.report(error)

    @property
    def text(self) -> str:
        """The key path alone."""
        return path_text(self.path)

    def error(self, what: str, *, expected: str, actual: object, fix: str) -> GamekeeperError:
        """An error that names this place; `actual` is shown as a value, cut where it is long."""
        where = self.places.at(self.path)
        refusal = self.places.refusal
        return refusal(what, where=where, expected=expected, actual=shown(actual), fix=fix)

    def unknown(
        self, what: str, word: object, known: Iterable[str], *, noun: str
    ) -> GamekeeperError:
        """An error for a word that isn't among the known ones, with the nearest as its fix."""
        options = list(known)
        near = nearest(word, options)
        listed = ", ".join(repr(option) for option in options) or f"none: no {noun} is declared"
        fix = f"write '{near}'" if near else f"use one of the {noun}s that are listed"
        if not options:
            fix = f"declare the {noun} first, or leave this out"
        return self.error(what, expected=listed, actual=word, fix=fix)

    def table(self, value: object) -> Mapping[str, object]:
        """The value as a table with text for keys.

        Raises:
            ContractError: it is something else.
        """
        if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
            return value
        example = "roles.picker" if self.places.document == "contract" else "environments.NAME"
        raise self.error(
            f"'{self.text or f'the {self.places.document}'}' is not a table",
            expected="a table of names and values",
            actual=value,
            fix=f"write a section [{self.text or example}] with its keys below",
        )


def together(mistakes: Sequence[GamekeeperError], places: SourceLines) -> GamekeeperError:
    """One error for all mistakes of a text: a single one as it is, several as a numbered list.

    Args:
        mistakes: one at least; equal ones are listed once, in the order of their lines.
        places: lines of the text.
    """
    listed = sorted({str(each): each for each in mistakes}.values(), key=_line_of)
    if len(listed) == 1:
        return listed[0]
    numbered = [
        f"{number}. {each}".replace("\n", "\n   ") for number, each in enumerate(listed, start=1)
    ]
    error = places.refusal(
        "\n".join([f"the {places.document} has {len(listed)} mistakes", *numbered]).replace(
            "\n", "\n  "
        ),
        where="; ".join(dict.fromkeys(each.where for each in listed if each.where)),
        expected=f"a {places.document} without mistakes",
        actual=f"{len(listed)} mistakes",
        fix="correct every one; each has its fix beside it",
    )
    vars(error)[PARTS] = tuple(listed)
    return error


PARTS: Final = "mistakes"
"""Attribute of an error that `together` made of several."""


def mistakes_in(error: GamekeeperError) -> tuple[GamekeeperError, ...]:
    """The errors that `together` made one of; any other error alone."""
    return tuple(vars(error).get(PARTS, (error,)))


LINE_NUMBER: Final = re.compile(r", line (\d+)")


def _line_of(error: GamekeeperError) -> int:
    found = LINE_NUMBER.search(error.where)
    return int(found.group(1)) if found else 0


NOWHERE: Final = SourceLines()
"""The places of what never was a text."""

Read: TypeAlias = Callable[[object, SourcePath], T]
"""Reads a value that stands at a place."""


def can_be_told(name: str) -> bool:
    """The text isn't blank, and any file can hold it."""
    return bool(name.strip()) and not any("\ud800" <= char <= "\udfff" for char in name)


def text(value: object, at: SourcePath) -> str:
    """The value as text that any file can hold.

    Raises:
        ContractError: it is something else, empty, or holds half of a surrogate pair.
    """
    if not isinstance(value, str):
        raise at.error(
            f"'{at.text}' is not text",
            expected="text in quotes",
            actual=value,
            fix="put it in quotes",
        )
    if not can_be_told(value):
        raise at.error(
            f"'{at.text}' is empty",
            expected="text of at least one letter",
            actual=value,
            fix="write a text, or leave the key out",
        )
    return str(value)


def truth(value: object, at: SourcePath) -> bool:
    """The value as true or false."""
    if isinstance(value, bool):
        return value
    fix = "write it without quotes" if value in ("true", "false") else "write true or false"
    raise at.error(
        f"'{at.text}' is not a truth value", expected="true or false", actual=value, fix=fix
    )


def whole(least: int) -> Read[int]:
    """Reads whole numbers from `least` on that fit into 64 bits."""

    def read(value: object, at: SourcePath) -> int:
        if not isinstance(value, bool) and isinstance(value, Integral):
            number = int(value)
            if least <= number < 2**63:
                return number
        raise at.error(
            f"'{at.text}' is not a whole number from {least} on",
            expected=f"a whole number, at least {least}",
            actual=value,
            fix=f"write a whole number from {least} on, or leave the key out",
        )

    return read


def word(*allowed: str) -> Read[str]:
    """Reads one of the allowed words."""

    def read(value: object, at: SourcePath) -> str:
        if isinstance(value, str) and value in allowed:
            return str(value)
        raise at.unknown(f"'{at.text}' can't be {shown(value)}", value, allowed, noun="word")

    return read


def listed(item: Read[T], *, least: int = 0) -> Read[tuple[T, ...]]:
    """Reads lists with at least `least` items."""

    def read(value: object, at: SourcePath) -> tuple[T, ...]:
        if not isinstance(value, list | tuple) or len(value) < least:
            raise at.error(
                f"'{at.text}' is not a list" + (f" of {least} or more" if least else ""),
                expected="a list in square brackets" + (f", {least} or more" if least else ""),
                actual=value,
                fix="put the items into [ ]" if not isinstance(value, list | tuple) else "fill it",
            )
        return tuple(item(each, at / number) for number, each in enumerate(value))

    return read


def names(value: object, at: SourcePath) -> tuple[str, ...]:
    """Reads one name, or a list of different names."""
    if isinstance(value, str):
        return (text(value, at),)
    return different(listed(text, least=1)(value, at), at)


def different(items: tuple[str, ...], at: SourcePath) -> tuple[str, ...]:
    """The items, none of which stands twice.

    Raises:
        ContractError: one stands twice.
    """
    for number, item in enumerate(items):
        if item in items[:number]:
            raise (at / number).error(
                f"{item!r} stands twice in '{at.text}'",
                expected="each name once",
                actual=list(items),
                fix="leave the second out",
            )
    return items


def number(low: float, high: float) -> Read[float]:
    """Reads numbers between two others, without these."""

    def read(value: object, at: SourcePath) -> float:
        if not isinstance(value, bool) and isinstance(value, int | float) and low < value < high:
            return float(value)
        raise at.error(
            f"'{at.text}' is no such number",
            expected=f"a number between {low:g} and {high:g}",
            actual=value,
            fix="write a number of that range, or leave the key out",
        )

    return read


def section(
    cls: Callable[..., T],
    readers: Mapping[str, Read[object]],
    *required: str,
    lacking: str | None = None,
) -> Read[T]:
    """Reads a table with known keys into its class.

    Args:
        cls: takes what was read, by key.
        readers: of the values, by key.
        *required: keys that must stand there.
        lacking: the refusal where one doesn't; None: names the key.
    """

    def read(value: object, at: SourcePath) -> T:
        table = at.table(value)
        for key in table:
            if key not in readers:
                at.report(unknown_key(at / key, readers))
        found = {}
        for key, item in table.items():
            if key in readers and key not in required:
                with at.collecting():
                    found[key] = readers[key](item, at / key)
        for key in required:
            if key not in table:
                raise at.error(
                    lacking or f"'{at.text}' has no '{key}'",
                    expected=", ".join(required),
                    actual=", ".join(table) or "nothing",
                    fix=f"add {path_text((*at.path, key))}",
                )
            # Without it there is nothing to return, so its error ends the whole section.
            found[key] = readers[key](table[key], at / key)
        return cls(**found)

    return read


def unknown_key(at: SourcePath, known: Iterable[str]) -> GamekeeperError:
    """An error for a key that its section doesn't have."""
    key = at.path[-1]
    inside = f"in [{path_text(at.path[:-1])}]" if len(at.path) > 1 else "at the top"
    near = nearest(key, known)
    return at.error(
        f"{key!r} is no key {inside} of a {at.places.document}",
        expected=", ".join(known),
        actual=key,
        fix=f"write '{near}'" if near else "use a key that is listed, or leave it out",
    )


def named(item: Read[T]) -> Read[Table[T]]:
    """Reads a table whose keys are names of the author's."""

    def read(value: object, at: SourcePath) -> Table[T]:
        rows = {}
        for key, each in at.table(value).items():
            with at.collecting():
                rows[text(key, at / key)] = item(each, at / key)
        return Table(rows)

    return read
