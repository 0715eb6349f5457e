"""Contracts as TOML: the lines of its keys on the way in, its usual layout on the way out."""

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Final

import tomli_w

from gamekeeper.contract.sections import Ending, RewardTerm, Role, Schedule, Seeds
from gamekeeper.contract.validation import BARE, Path, SourceLines, one_line, path_text
from gamekeeper.errors import ContractError

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
    return _TomlScanner(text).scan()


class _TomlScanner:
    """Walks the tokens of a TOML text and notes where each path begins."""

    def __init__(self, text: str) -> None:
        self.lines: dict[Path, int] = {}
        self.counts: dict[Path, int] = {}
        self.tokens = _tokens(text)
        self.kind, self.token, self.line = "", "", 1
        self.next()

    def next(self) -> None:
        self.kind, self.token, self.line = next(self.tokens, ("end", "", self.line))

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
            while self.kind == "newline":
                self.next()
            if self.kind == "sign" and self.token == close:
                self.next()
                return
            if self.kind == "sign" and self.token == ",":
                self.next()
            elif close == "}":
                self.pair(path)
            else:
                self.note((*path, number), self.line)
                before = self.kind, self.token, self.line
                self.value((*path, number))
                number += 1
                if before == (self.kind, self.token, self.line):
                    self.next()


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


@dataclass(frozen=True, slots=True)
class Question:
    """Asks for one declaration by the name of its key.

    Args:
        path: key path of the answer, as ("roles", "picker", "noop").
        ask: the question, as one sentence.
        answer: what the answer looks like, as `N` or `true | false`.
        hint: what the answer can be, as `N in 0 to 4`.
        lines: TOML lines to fill in, where the answer is more than one value.
        example: TOML of one possible answer; empty: `answer` is TOML.
        measured: TOML of the answer that was measured; empty: it wasn't.
        why: why the answer matters.
    """

    path: tuple[str, ...]
    ask: str
    answer: str
    hint: str = ""
    lines: tuple[str, ...] = ()
    example: str = ""
    measured: str = ""
    why: str = ""

    @property
    def key(self) -> str:
        """The key path as a reader types it: `roles.picker.noop`."""
        return path_text(self.path)

    @property
    def proposal(self) -> tuple[str, str]:
        """TOML of an answer to take or to change, and the note that stands behind it."""
        if self.measured:
            return self.measured, f"measured; else {self.answer}"
        return (self.example, self.answer) if self.example else (self.answer, "")

    def __str__(self) -> str:
        hint = f" ({self.hint})" if self.hint else ""
        return f"{self.ask} -> {self.key} = {self.answer}{hint}"


NOTES_AT: Final = 30
"""Column at which the notes behind short answers begin."""
LINE: Final = re.compile(r"\(at line (\d+), column (\d+)\)")
TABLES: Final[Mapping[str, tuple[str, ...]]] = {
    "roles": tuple(field.name for field in fields(Role)),
    "rewards": tuple(field.name for field in fields(RewardTerm)),
    "endings": tuple(field.name for field in fields(Ending)),
}
"""Sections of tables and the keys of these; an ending is one only where it has questions."""
KEYS: Final[Mapping[str, tuple[str, ...]]] = {
    "": ("name", "api", "why"),
    "schedule": tuple(field.name for field in fields(Schedule)),
    "roles": (),
    "rewards": (),
    "endings": (),
    "seeds": tuple(field.name for field in fields(Seeds)),
    "infos": (),
    "knobs": (),
    "scene": (),
    "failure": (),
    "waivers": (),
}
"""Sections and their keys in the order they are written."""
SECTIONS: Final = tuple(KEYS)[1:]


def parse_toml(text: str, *, source: str) -> tuple[dict[str, object], SourceLines]:
    """The data of a TOML text, and the lines of its keys.

    Raises:
        ContractError: the text isn't TOML.
    """
    try:
        return tomllib.loads(text), SourceLines(source, key_lines(text))
    except tomllib.TOMLDecodeError as error:
        raise _syntax_error(text, str(error), source) from None
    except (RecursionError, ValueError) as error:
        # Endless brackets and numbers of thousands of digits leave tomllib as these.
        raise ContractError(
            "the contract can't be read as TOML",
            where=source,
            expected="TOML of ordinary depth and length",
            actual=type(error).__name__,
            fix="take out what is nested deeply or very long",
        ) from None


def _syntax_error(text: str, message: str, source: str) -> ContractError:
    found = LINE.search(message)
    lines = text.splitlines() or [""]
    number = int(found.group(1)) if found else len(lines)
    written = lines[min(number, len(lines)) - 1].strip()
    twice = "overwrite" in message or "twice" in message
    key = written.split("=")[0].strip(" []")
    parser = LINE.sub("", message).strip()
    what = f"{key!r} is declared twice" if twice else f"the contract isn't TOML: {parser}"
    fix = "keep one of the two" if twice else "fix the line: text stands in quotes, lists in [ ]"
    return ContractError(
        what,
        where=f"{source}, line {number}" + (f", column {found.group(2)}" if found else ""),
        expected="each key once" if twice else "key = value, or [section]",
        actual=written[:80],
        fix=fix,
    )


def write_toml(data: Mapping[str, object], questions: tuple[Question, ...]) -> str:
    """The contract's plain data in the layout of the documentation, with questions in place."""
    writer = _TomlWriter(questions)
    blocks = [writer.block((), KEYS[""], data)]
    for section in SECTIONS:
        blocks += writer.section(section, data.get(section, {}))
    asked = [line for path in list(writer.asked) for line in writer.comment(path)]
    return "\n\n".join(block for block in [*blocks, "\n".join(asked)] if block) + "\n"


class _TomlWriter:
    """Writes blocks of TOML; a question leaves `asked` where it has found its place."""

    def __init__(self, questions: tuple[Question, ...]) -> None:
        self.asked = {question.path: question for question in questions}

    def section(self, name: str, table: object) -> list[str]:
        """The blocks of a section: its own lines, a block for each table in it, what is open."""
        rows = table if isinstance(table, Mapping) else {}
        asked = {path[1]: len(path) for path in self.asked if path[0] == name and len(path) > 1}
        inner = [
            key
            for key, row in rows.items()
            if name in TABLES and isinstance(row, Mapping)
            if name != "endings" or asked.get(key, 0) > 2
        ]
        own = [key for key in dict.fromkeys((*KEYS[name], *rows, *asked)) if key not in inner]
        blocks = [self.block((name,), own, rows)]
        blocks += [self.block((name, key), TABLES[name], rows[key], always=True) for key in inner]
        return [*blocks, "\n".join(self.comment((name,)))]

    def block(
        self,
        path: tuple[str, ...],
        keys: Sequence[str],
        row: Mapping[str, object],
        *,
        always: bool = False,
    ) -> str:
        """A header and its keys; nothing where there is nothing to say, unless `always`."""
        lines: list[str] = []
        for key in keys:
            if key in row:
                lines.append(f"{key_text(key)} = {value_text(row[key])}")
            inside = [each for each in self.asked if each[: len(path) + 1] == (*path, key)]
            lines += [line for each in inside for line in self.comment(each)]
        if path and (lines or always):
            lines.insert(0, f"[{'.'.join(key_text(key) for key in path)}]")
        return "\n".join(lines)

    def comment(self, path: tuple[str, ...]) -> list[str]:
        """The question at the path as comment lines, with the key to uncomment below it.

        The question has two signs and the answer one: without one of them every line is TOML.
        """
        question = self.asked.pop(path, None)
        if question is None:
            return []
        value, note = question.proposal
        line = f"{key_text(path[-1])} = {value}"
        if note:
            line = f"{line:<{NOTES_AT}}  # {one_line(note)}"
        ask = f"{question.ask} ({question.hint})" if question.hint else question.ask
        why = [f"## Why it matters: {one_line(question.why)}."] if question.why else []
        return [f"## {one_line(ask)}", *why, *(f"# {each}" for each in question.lines or (line,))]


def key_text(key: str) -> str:
    """The key as TOML, in quotes where it must be."""
    return key if BARE.fullmatch(key) else value_text(key)


def value_text(value: object) -> str:
    """The value as TOML on one line."""
    if isinstance(value, Mapping):
        rows = [f"{key_text(key)} = {value_text(item)}" for key, item in value.items()]
        return "{ " + ", ".join(rows) + " }" if rows else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(value_text(item) for item in value) + "]"
    return tomli_w.dumps({"v": value}).removeprefix("v = ").removesuffix("\n")
