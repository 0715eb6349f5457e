"""Where a command's words go: its result to stdout, everything else to stderr."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final, TextIO

from gamekeeper.cli._document import Document, document_text

NARROWEST: Final = 60
WIDEST: Final = 110
"""Columns that results are laid out for; longer lines are hard to read."""
STYLES: Final = {"good": "bold green", "bad": "bold red", "unsure": "bold yellow"}


@dataclass(frozen=True, slots=True)
class Answer:
    """What a command came to.

    Args:
        document: what --json prints; fields as INTERFACE names them.
        code: the exit code.
    """

    document: Document = field(default_factory=dict)
    code: int = 0


@dataclass(frozen=True, slots=True)
class Screen:
    """The outputs of one command.

    Args:
        out: takes results alone.
        is_json: results are one document at the end; texts are dropped.
        is_quiet: no progress and no notes; errors are always said.
    """

    out: TextIO
    is_json: bool = False
    is_quiet: bool = False

    @property
    def width(self) -> int:
        """Columns that results may fill; 80 where it is no terminal."""
        columns = shutil.get_terminal_size().columns if self.out.isatty() else 80
        return min(max(columns, NARROWEST), WIDEST)

    def show(self, text: str) -> None:
        """Writes a part of the result. Lines that aren't indented are headings."""
        if self.is_json:
            return
        text = visible(text)
        if has_colours(self.out):
            text = _coloured(text)
        self._write(f"{text.rstrip()}\n")

    def program(self, text: str) -> None:
        """Writes code as it is, so that it can be copied."""
        if not self.is_json:
            self._write(f"{text.rstrip()}\n")

    def verdict(self, text: str, manner: str, *, indent: str = "") -> None:
        """Writes a result whose first line is the verdict: `good`, `bad` or `unsure`."""
        if self.is_json:
            return
        first, newline, rest = visible(text).rstrip().partition("\n")
        if has_colours(self.out):
            first = _painted(first, STYLES[manner])
        self._write(textwrap.indent(f"{first}{newline}{rest}", indent) + "\n")

    def document(self, document: Document) -> None:
        """Writes the one document of --json; nothing without."""
        if self.is_json:
            self._write(f"{document_text(document)}\n")

    def _write(self, text: str) -> None:
        try:
            self.out.write(text)
            self.out.flush()
        except BrokenPipeError:
            return  # the reader has what it wanted; `claimed_stdout` cleans up

    def note(self, text: str) -> None:
        """Says something that is no result, on stderr."""
        if not self.is_quiet:
            self.error(text)

    def error(self, text: str) -> None:
        """Says on stderr what went wrong, also when quiet."""
        sys.stderr.write(f"{visible(text).rstrip()}\n")
        sys.stderr.flush()

    @contextmanager
    def progress(self, title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
        """Shows progress on stderr if that is a terminal; yields what takes a task's reports.

        A report may name `episodes`, `episode` (how many are done) and `turns`.
        """
        if self.is_quiet or not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
            yield lambda fields: None
            return
        from gamekeeper.cli._progress import live_progress

        with live_progress(title) as take:
            yield take


def visible(text: str) -> str:
    """The text with its control characters written out, so that no terminal obeys an agent's name.

    Ends of lines and tabs stay; half of a surrogate pair, which no stream takes, goes too.
    """
    return "\n".join(map(_visible_line, text.split("\n")))


def _visible_line(line: str) -> str:
    if line.isprintable():
        return line
    return "".join(
        sign if sign.isprintable() or sign == "\t" else f"\\u{ord(sign):04x}" for sign in line
    )


def has_colours(stream: TextIO) -> bool:
    """Whether colours may be written: to a terminal, unless NO_COLOR is set (no-color.org)."""
    is_dumb = os.environ.get("TERM") == "dumb"
    return stream.isatty() and not os.environ.get("NO_COLOR") and not is_dumb


def _coloured(text: str) -> str:
    """Headings bold: a line that isn't indented, up to the first run of two spaces."""
    lines = []
    for line in text.split("\n"):
        head, gap, rest = line.partition("  ")
        lines.append(f"{_painted(head, 'bold')}{gap}{rest}" if head else line)
    return "\n".join(lines)


def _painted(text: str, style: str) -> str:
    codes = {"bold": "1", "red": "31", "green": "32", "yellow": "33"}
    return f"\033[{';'.join(codes[word] for word in style.split())}m{text}\033[0m"
