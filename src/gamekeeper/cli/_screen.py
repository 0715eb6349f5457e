"""Outputs of a command: its result to stdout, everything else to stderr."""

import json
import os
import pkgutil
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from shlex import quote
from typing import Any, Final, TextIO

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from gamekeeper.cli._stdout import silence
from gamekeeper.episodes.plain_json import finite
from gamekeeper.terminal import say, visible

# -- The name by which a person started this command line, in commands that are to be typed

NAME: Final = "gamekeeper"


def typed_name() -> str:
    """`gamekeeper`; its path, or `python -m gamekeeper`, where that is how it was started.

    A path is given only where the shell wouldn't find this very command by its name.
    """
    typed = Path(sys.argv[0])
    if typed.name == "__main__.py" and typed.parent.name == NAME:
        return f"{quote(sys.orig_argv[0])} -m {NAME}"
    if typed.name != NAME or not typed.is_file():
        return NAME
    found = shutil.which(NAME)
    is_found = found is not None and Path(found).samefile(typed)
    return NAME if is_found else quote(str(sys.argv[0]))


def as_typed(text: str) -> str:
    """The text, with each command in it named as the person named it."""
    if f"{NAME} " not in text:
        return text
    name = typed_name()
    return text if name == NAME else _commands().sub(lambda _: name, text)


@cache
def _commands() -> re.Pattern[str]:
    """The name in front of one of its commands, and not as part of a path or another name."""
    found = pkgutil.iter_modules([str(Path(__file__).parent)])
    names = "|".join(each.name.replace("_", "-") for each in found if each.name[0] != "_")
    return re.compile(rf"(?<![\w./-]){NAME}(?= (?:{names})\b)")


Document = Mapping[str, Any]


def document_text(document: Document) -> str:
    """One JSON document on one line, in ASCII; a number that JSON lacks (NaN, infinity) is null."""
    return json.dumps(finite(document), allow_nan=False)


NARROWEST: Final = 60
WIDEST: Final = 110
"""Columns that results are laid out for; longer lines are hard to read."""
STYLES: Final = {"good": "bold green", "bad": "bold red", "unsure": "bold yellow"}


@dataclass(frozen=True, slots=True)
class CommandResult:
    """Result of a command."""

    document: Document = field(default_factory=dict)
    code: int = 0


@dataclass(frozen=True, slots=True)
class Screen:
    """The outputs of one command.

    Args:
        is_json: results are one document at the end; texts are dropped.
        is_quiet: no progress and no notes; errors are always said.
    Attributes:
        lost: errors of results that couldn't be written. The work continues without them, so that
            a recording is finalized all the same.
    """

    out: TextIO
    is_json: bool = False
    is_quiet: bool = False
    lost: list[OSError] = field(default_factory=list, init=False)

    @property
    def width(self) -> int:
        """Columns that results may fill; 80 where it is no terminal."""
        columns = shutil.get_terminal_size().columns if self.out.isatty() else 80
        return min(max(columns, NARROWEST), WIDEST)

    def show(self, text: str) -> None:
        """Writes a part of the result. Lines that aren't indented are headings."""
        if self.is_json:
            return
        text = visible(as_typed(text))
        if has_colours(self.out):
            text = _coloured(text)
        self._write(f"{text.rstrip()}\n")

    def program(self, text: str) -> None:
        """Writes code as it is, so that it can be copied; control characters as their escapes."""
        if not self.is_json:
            self._write(f"{visible(text).rstrip()}\n")

    def verdict(self, text: str, manner: str, *, indent: str = "") -> None:
        """Writes a result whose first line is the verdict: `good`, `bad` or `unsure`."""
        if self.is_json:
            return
        first, newline, rest = visible(as_typed(text)).rstrip().partition("\n")
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
        except OSError as error:  # no space left, or a reader that has gone
            self.lost.append(error)
            silence(self.out)

    def note(self, text: str) -> None:
        """Writes a note, which is no result, to stderr."""
        if not self.is_quiet:
            self.error(text)

    def error(self, text: str) -> None:
        """Writes an error to stderr, also with --quiet."""
        say(as_typed(text))

    @contextmanager
    def progress(self, title: str) -> Iterator[Callable[[dict[str, Any]], None]]:
        """Shows progress on stderr if that is a terminal; yields a function for a task's reports.

        A report may name `episodes`, `episode` (the number that is done) and `turns`.
        """
        if self.is_quiet or not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
            yield lambda fields: None
            return

        with live_progress(title) as take:
            yield take


def has_colours(stream: TextIO) -> bool:
    """Tells if colours may be written: to a terminal, unless NO_COLOR is set (no-color.org)."""
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


WIDEST_BAR: Final = 24
TIMES: Final = len(" 0:00:00 left: 0:00:00")
"""Columns of time and time left, which aren't shortened."""
AROUND: Final = len("* ") + len("  ")
"""Columns of the spinner, and of the gaps around the bar."""


def fitted(bar: BarColumn, texts: Sequence[str], room: int) -> str:
    """The first of the texts that fits beside the bar, which gets the columns that are left.

    Args:
        texts: from the longest to the shortest; the last where none fits.
        room: columns for both.
    """
    text = next((each for each in texts if len(each) < room), texts[-1])
    bar.bar_width = min(max(room - len(text), 1), WIDEST_BAR)
    return text


@contextmanager
def live_progress(
    title: str, console: Console | None = None
) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Shows a line with counts, time and time left; yields a function for a task's reports.

    On a narrow terminal the bar and the counts are shortened, the times aren't.
    """
    console = console or Console(stderr=True)
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        bar := BarColumn(),
        TextColumn("{task.fields[counts]}"),
        TimeElapsedColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(),
    )
    room = console.width - TIMES - AROUND - len(title)
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(title, total=None, counts=fitted(bar, [""], room))
        known: dict[str, Any] = {}

        def take(fields: dict[str, Any]) -> None:
            known.update(fields)
            done, of = ("merged", "parts") if "merged" in known else ("episode", "episodes")
            progress.update(
                task,
                total=known.get(of) if done in known else None,  # None: it pulses
                completed=known.get(done, 0),
                counts=fitted(bar, _counts(known), room),
            )

        yield take


def _counts(known: dict[str, Any]) -> list[str]:
    """Counts of a task, from the longest text to the shortest."""
    if "merged" in known:
        parts = f"{known['merged']:,} of {known['parts']:,}"
        return [f"merging: {parts} parts", parts]
    steps = f"{known['turns']:,} steps" if "turns" in known else ""
    if not ("episode" in known and "episodes" in known):
        return [steps]
    share = f"{known['episode']:,} of {known['episodes']:,}"
    counts = f"{share} {known.get('unit', 'episodes')}"
    return [f"{counts}, {steps}" if steps else counts, counts, share]
