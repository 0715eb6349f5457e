"""Contracts as TOML: the lines of its keys on the way in, its usual layout on the way out."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Final

import tomli_w

from gamekeeper.core.contract.parts import RewardTerm, Role, Schedule, Seeds
from gamekeeper.core.contract.places import BARE, Places, one_line
from gamekeeper.core.contract.question import Question
from gamekeeper.core.contract.toml_lines import key_lines
from gamekeeper.errors import ContractError

LINE: Final = re.compile(r"\(at line (\d+), column (\d+)\)")
TABLES: Final = ("roles", "rewards")
"""Sections whose entries are tables of their own; the others' entries stand on one line."""
KEYS: Final[Mapping[str, tuple[str, ...]]] = {
    "": ("name", "api", "why"),
    "schedule": tuple(field.name for field in fields(Schedule)),
    "roles": tuple(field.name for field in fields(Role)),
    "rewards": tuple(field.name for field in fields(RewardTerm)),
    "endings": (),
    "seeds": tuple(field.name for field in fields(Seeds)),
    "infos": (),
    "knobs": (),
    "failure": (),
    "waivers": (),
}
"""Sections and their keys in the order they are written."""
SECTIONS: Final = tuple(KEYS)[1:]


def parse_toml(text: str, *, source: str) -> tuple[dict[str, object], Places]:
    """The data of a TOML text, and the lines of its keys.

    Raises:
        ContractError: the text isn't TOML.
    """
    try:
        return tomllib.loads(text), Places(source, key_lines(text))
    except tomllib.TOMLDecodeError as error:
        raise _syntax_error(text, str(error), source) from None
    except (RecursionError, ValueError) as error:
        # Endless brackets and numbers of thousands of digits leave tomllib as these.
        raise ContractError(
            "the contract can't be read as TOML",
            where=source,
            expected="TOML that people write",
            seen=type(error).__name__,
            mend="take out what is nested deeply or very long",
        ) from None


def _syntax_error(text: str, message: str, source: str) -> ContractError:
    found = LINE.search(message)
    lines = text.splitlines() or [""]
    number = int(found.group(1)) if found else len(lines)
    written = lines[min(number, len(lines)) - 1].strip()
    twice = "overwrite" in message or "twice" in message
    key = written.split("=")[0].strip(" []")
    what = f"{key!r} is declared twice" if twice else "the contract is not TOML"
    mend = "keep one of the two" if twice else "mend the line: text stands in quotes, lists in [ ]"
    return ContractError(
        what,
        where=f"{source}, line {number}" + (f", column {found.group(2)}" if found else ""),
        expected="each key once" if twice else LINE.sub("", message).strip(),
        seen=written[:80],
        mend=mend,
    )


def write_toml(data: Mapping[str, object], questions: tuple[Question, ...]) -> str:
    """The contract's plain data in the layout of the documentation, with questions in place."""
    writer = _Writer(questions)
    blocks = [writer.block((), KEYS[""], data)]
    for section in SECTIONS:
        blocks += writer.section(section, data.get(section, {}))
    asked = [line for path in list(writer.asked) for line in writer.comment(path)]
    return "\n\n".join(block for block in [*blocks, "\n".join(asked)] if block) + "\n"


class _Writer:
    """Writes blocks of TOML; a question leaves `asked` where it has found its place."""

    def __init__(self, questions: tuple[Question, ...]) -> None:
        self.asked = {question.path: question for question in questions}

    def section(self, name: str, table: object) -> list[str]:
        """The blocks of a section: its own lines, a block for each table in it, what is open."""
        rows = table if isinstance(table, Mapping) else {}
        inner = [key for key in rows if name in TABLES and isinstance(rows[key], Mapping)]
        asked = [path[1] for path in self.asked if path[0] == name and len(path) > 1]
        known = KEYS[name] if name not in TABLES else ()
        own = [key for key in dict.fromkeys((*known, *rows, *asked)) if key not in inner]
        blocks = [self.block((name,), own, rows)]
        blocks += [self.block((name, key), KEYS[name], rows[key], always=True) for key in inner]
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
        """The question at the path as comment lines, with the key to uncomment below it."""
        question = self.asked.pop(path, None)
        if question is None:
            return []
        answer = question.lines or (f"{key_text(path[-1])} = {question.answer}",)
        ask = f"{question.ask} ({question.hint})" if question.hint else question.ask
        return [f"# {line}" for line in (one_line(ask), *answer)]


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
