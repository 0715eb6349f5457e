"""The lines on which the keys and list items of a TOML text stand, which `tomllib` doesn't tell."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from typing import Final

from gamekeeper.core.contract.places import Path

TOKEN: Final = re.compile(
    r'''(?P<blank>[ \t\r]+|\#[^\n]*)|(?P<newline>\n)
    |(?P<long>"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?'{3,5})
    |(?P<quoted>"(?:\\.|[^"\\\n])*"|'[^'\n]*')
    |(?P<sign>[\[\]{}=,.])|(?P<bare>[^\s\[\]{}=,."'\#]+)''',
    re.DOTALL | re.VERBOSE,
)


def key_lines(text: str) -> dict[Path, int]:
    """The line of each key and list item, counted from 1.

    Args:
        text: TOML that `tomllib` has read; on other text the lines may be wrong, but it ends.
    """
    return _Scanner(text).scan()


class _Scanner:
    """Walks the tokens of a TOML text and notes where each path begins."""

    def __init__(self, text: str) -> None:
        self.lines: dict[Path, int] = {}
        self.counts: dict[Path, int] = {}
        self.tokens = _tokens(text)
        self.kind, self.token, self.line = "", "", 1
        self.next()

    def next(self) -> None:
        self.kind, self.token, self.line = next(self.tokens, ("end", "", self.line))

    def skip(self) -> None:
        while self.kind == "newline":
            self.next()

    def scan(self) -> dict[Path, int]:
        table: Path = ()
        while self.kind != "end":
            if self.kind == "newline":
                self.next()
            elif self.token == "[" and self.kind == "sign":
                table = self.header()
            else:
                self.pair(table)
        return self.lines

    def note(self, path: Path, line: int) -> None:
        """The first line counts: a table that is opened again stays where it began."""
        for length in range(1, len(path) + 1):
            self.lines.setdefault(path[:length], line)

    def header(self) -> Path:
        line = self.line
        self.next()
        many = self.token == "["
        if many:
            self.next()
        path = self.keys()
        while self.kind not in ("newline", "end"):
            self.next()
        if many:
            number = self.counts.get(path, 0)
            self.counts[path] = number + 1
            path = (*path, number)
        self.note(path, line)
        return path

    def keys(self) -> Path:
        """A dotted key, up to the sign that ends it."""
        path: list[str | int] = []
        while self.kind in ("bare", "quoted") or self.token == ".":
            if self.token != "." or self.kind == "quoted":
                path.append(_unquoted(self.token) if self.kind == "quoted" else self.token)
            self.next()
        return tuple(path)

    def pair(self, table: Path) -> None:
        line = self.line
        path = (*table, *self.keys())
        self.note(path, line)
        if self.token == "=":
            self.next()
            self.value(path)
        elif self.kind not in ("newline", "end"):
            self.next()

    def value(self, path: Path) -> None:
        """A value of any kind, whose inner keys and items are noted too."""
        if self.kind == "sign" and self.token in "[{":
            close = "]" if self.token == "[" else "}"
            self.next()
            self.inside(path, close)
            return
        while self.kind in ("bare", "quoted", "long") or self.token == ".":
            self.next()

    def inside(self, path: Path, close: str) -> None:
        number = 0
        while self.kind != "end":
            self.skip()
            if self.kind == "sign" and self.token == close:
                self.next()
                return
            if self.kind == "sign" and self.token == ",":
                self.next()
            elif close == "}":
                self.pair(path)
            else:
                self.note((*path, number), self.line)
                before = self.tokens_left
                self.value((*path, number))
                number += 1
                if before == self.tokens_left:
                    self.next()

    @property
    def tokens_left(self) -> tuple[str, str, int]:
        return self.kind, self.token, self.line


def _tokens(text: str) -> Iterator[tuple[str, str, int]]:
    line, at = 1, 0
    while at < len(text):
        found = TOKEN.match(text, at)
        if found is None:
            at += 1
            continue
        kind, token = found.lastgroup or "", found.group()
        if kind != "blank":
            yield kind, token, line
        line += token.count("\n")
        at = found.end()


def _unquoted(token: str) -> str:
    try:
        return str(tomllib.loads(f"k = {token}")["k"])
    except tomllib.TOMLDecodeError:
        return token[1:-1]
