"""The card of an environment: its game form on one page, as text, Markdown and JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest
from typing import Final

from gamekeeper.core.contract import Contract, Question
from gamekeeper.core.contract.agent_spec import AgentSpec
from gamekeeper.core.contract.places import one_line
from gamekeeper.core.contract.questions import open_questions
from gamekeeper.report.card_rows import Section, card_sections
from gamekeeper.report.columns import columns_of, filled, wrapped
from gamekeeper.report.space_text import space_text

NARROWEST: Final = 40
"""Columns below which lines are not broken any more."""
INDENT: Final = 2
GAP: Final = 2
"""Spaces before a row, and between its columns."""


def card_text(
    contract: Contract,
    agents: Iterable[AgentSpec] = (),
    *,
    width: int = 80,
    questions: Sequence[Question] | None = None,
) -> str:
    """The card as plain text without colour codes.

    Args:
        contract: what is declared.
        agents: in the order of the roster.
        width: columns that no line exceeds, at least 40.
        questions: what is still open; None: as the contract alone shows it.
    """
    specs = tuple(agents)
    wide = max(width, NARROWEST)
    lines = [*_wrapped(_title(contract), wide, "", "  ")]
    if contract.why:
        lines += _wrapped(one_line(contract.why), wide, "  ", "  ")
    for section in card_sections(contract, specs):
        lines += ["", section.title, *_columns(section, wide)]
    asked = _asked(contract, specs, questions)
    if asked:
        lines += ["", f"Not declared, so not judged ({len(asked)})"]
        for question in asked:
            text = f"{question.ask} -> {question.key} = {question.answer}"
            lines += _wrapped(one_line(text), wide, "  ", "      ")
    return "\n".join(lines) + "\n"


def card_markdown(
    contract: Contract,
    agents: Iterable[AgentSpec] = (),
    *,
    questions: Sequence[Question] | None = None,
) -> str:
    """The card as Markdown: a heading, a table for each section, a list of open questions."""
    specs = tuple(agents)
    blocks = [f"# {_escaped(_title(contract))}"]
    if contract.why:
        blocks.append(_escaped(contract.why))
    for section in card_sections(contract, specs):
        head = section.head or ("",) * len(section.rows[0])
        rows = [head, ("---",) * len(head), *section.rows]
        table = "\n".join("| " + " | ".join(map(_cell, row)) + " |" for row in rows)
        blocks += [f"## {section.title}", table]
    asked = _asked(contract, specs, questions)
    if asked:
        blocks += ["## Not declared, so not judged", "\n".join(map(_item, asked))]
    return "\n\n".join(blocks) + "\n"


def card_toml(
    contract: Contract,
    agents: Iterable[AgentSpec] = (),
    *,
    questions: Sequence[Question] | None = None,
) -> str:
    """The contract as TOML, its open questions standing as comments where the answers go."""
    return contract.to_toml(_asked(contract, tuple(agents), questions))


def card_json(
    contract: Contract,
    agents: Iterable[AgentSpec] = (),
    *,
    questions: Sequence[Question] | None = None,
) -> dict[str, object]:
    """The card as plain data."""
    specs = tuple(agents)
    return {
        "name": contract.name,
        "api": contract.api,
        "why": contract.why,
        "agents": [_agent_json(spec) for spec in specs],
        "contract": contract.to_json(),
        "questions": [
            {"key": each.key, "ask": each.ask, "answer": each.answer, "hint": each.hint}
            for each in _asked(contract, specs, questions)
        ],
    }


def _agent_json(spec: AgentSpec) -> dict[str, object]:
    return {
        "name": spec.name,
        "role": spec.role,
        "observation_space": space_text(spec.observation_space, limit=1_000),
        "action_space": space_text(spec.action_space, limit=1_000),
    }


def _asked(
    contract: Contract, specs: tuple[AgentSpec, ...], questions: Sequence[Question] | None
) -> tuple[Question, ...]:
    return open_questions(contract, specs) if questions is None else tuple(questions)


def _title(contract: Contract) -> str:
    api = {"parallel": "Parallel", "aec": "AEC"}.get(contract.api or "", "API not declared")
    return one_line(f"{contract.name or 'an environment without a name'} ({api})")


def _columns(section: Section, width: int) -> Iterator[str]:
    """Rows in aligned columns; a cell too wide for its column goes on below."""
    rows = [section.head, *section.rows] if section.head else [*section.rows]
    natural = [max(map(columns_of, column)) for column in zip(*rows, strict=True)]
    widths = _fitted(natural, width - INDENT - GAP * (len(natural) - 1))
    for row in rows:
        cells = [_wrapped(cell, columns, "", "") for cell, columns in zip(row, widths, strict=True)]
        for parts in zip_longest(*cells, fillvalue=""):
            padded = (filled(part, columns) for part, columns in zip(parts, widths, strict=True))
            yield (" " * INDENT + (" " * GAP).join(padded)).rstrip()


def _fitted(natural: list[int], room: int) -> list[int]:
    """Widths that fit into the room; what is wide gives way to what is narrow."""
    left, fitted = room, [0] * len(natural)
    for done, column in enumerate(sorted(range(len(natural)), key=natural.__getitem__)):
        fitted[column] = max(min(natural[column], left // (len(natural) - done)), 1)
        left -= fitted[column]
    return fitted


def _wrapped(text: str, width: int, first: str, rest: str) -> list[str]:
    lines = wrapped(text, width, first=first, rest=rest)
    return [line.rstrip() for line in lines] or [first.rstrip()]


def _escaped(text: str) -> str:
    """The text with nothing left that Markdown or HTML would read as markup."""
    marked = one_line(text).replace("\\", "\\\\").replace("&", "&amp;").replace("<", "&lt;")
    for sign in "`*_[]|#":
        marked = marked.replace(sign, f"\\{sign}")
    return marked


def _cell(text: str) -> str:
    return "---" if text == "---" else _escaped(text)


def _item(question: Question) -> str:
    answer = one_line(f"{question.key} = {question.answer}").replace("`", "'")
    return f"- {_escaped(question.ask)} `{answer}`"


__all__ = ["Section", "card_json", "card_markdown", "card_text", "card_toml"]
