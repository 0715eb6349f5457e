"""A draft of a contract with what was measured beside its questions; it declares none of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Final

from gamekeeper.core.contract import Question
from gamekeeper.core.contract.parts import ORDERS
from gamekeeper.core.contract.toml import value_text
from gamekeeper.report.measured_text import words

Measured = Mapping[str, Any]

CONFLICTS: Final = {"none": "joint rule", "draws": "joint rule", "outcome": "ordered"}
"""What would have to be declared where the order of the action dictionary matters so much."""
LONGEST: Final = 200
"""Characters of what was measured, in a comment."""


def measured_questions(questions: Iterable[Question], measured: Measured) -> tuple[Question, ...]:
    """The same questions, each with what was measured as its answer or as a hint.

    Args:
        questions: what a contract leaves open.
        measured: as the audit's document has it.
    """
    return tuple(_measured(each, measured) for each in questions)


def draft_note(*, steps: int, seed: int) -> str:
    """The comment at the top of a measured draft, which says what it is."""
    lines = (
        f"A draft: what is called measured was seen in {steps:,} steps from seed {seed}.",
        "It is no declaration. Only you know what is meant: take the # away from a line where what",
        "was seen is as it should be, and the audit holds the environment to it from then on.",
    )
    return "".join(f"# {line}\n" for line in lines) + "\n"


def _measured(question: Question, measured: Measured) -> Question:
    value = _answer(question.path, measured)
    if value is not None:
        hint = f"measured; else {question.answer}" + (f"; {question.hint}" if question.hint else "")
        return replace(question, answer=value_text(value), hint=hint)
    seen = _hint(question.path, measured)
    if not seen:
        return question
    seen = seen if len(seen) <= LONGEST else f"{seen[:LONGEST]}..."
    return replace(question, hint="; ".join(filter(None, [question.hint, f"measured: {seen}"])))


def _answer(path: tuple[str, ...], measured: Measured) -> Any:
    """What was measured, in the words of a contract; None where it doesn't answer the question."""
    match path:
        case ("seeds", "deterministic"):
            return _plain(measured.get("deterministic"), bool)
        case ("schedule", "horizon"):
            return _plain(measured.get("horizon"), int)
        case ("schedule", "conflicts"):
            return CONFLICTS.get(str(measured.get("order_sensitive")))
        case ("schedule", "order"):
            schedule = measured.get("schedule")
            order = schedule.get("order") if isinstance(schedule, Mapping) else schedule
            return order if order in ORDERS else None
    return None


def _hint(path: tuple[str, ...], measured: Measured) -> str:
    """What was measured that helps with the answer; empty where nothing does."""
    match path:
        case ("why",):
            return str(measured.get("why") or "")
        case ("roles", role, "symmetric"):
            by_role = measured.get("symmetric")
            return words(by_role.get(role)) if isinstance(by_role, Mapping) else ""
        case ("schedule", "stages" | "order"):
            return words(measured.get("schedule"))
        case ("rewards" | "endings" as section, _):
            return words(measured.get("reward" if section == "rewards" else section))
    return ""


def _plain(value: Any, kind: type) -> Any:
    """The value where it is of that kind; a truth value is no number."""
    is_meant = kind is bool or not isinstance(value, bool)
    return value if isinstance(value, kind) and is_meant else None
