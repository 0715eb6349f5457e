"""Drafts of contracts with what an audit measured: proposals to take over, nothing declared."""

from collections.abc import Iterable, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import replace
from typing import Any, Final

from gamekeeper.contract import Question
from gamekeeper.contract.sections import CONFLICTS, OBSERVE, ORDERS
from gamekeeper.contract.toml import value_text
from gamekeeper.reporting.measured_text import ORDER_MATTERS, near_horizon, words

Measured = Mapping[str, Any]

WORDS: Final = {"order": ORDERS, "observe": OBSERVE, "conflicts": CONFLICTS}
"""Declarations of a schedule that can be measured, with the words of a contract for them."""
LONGEST: Final = 200
"""Characters of a measured value in a comment."""


def measured_questions(questions: Iterable[Question], measured: Measured) -> tuple[Question, ...]:
    """Adds measured values to questions, as their answers or as hints.

    An answer is taken over only where it was measured as such: the order of turns that an AEC
    environment has anyway is a hint, no answer to the question for the order of the game.

    Args:
        questions: declarations that are missing.
        measured: as the audit's document has it.
    """
    asked = tuple(questions)
    roles = {each.path[1] for each in asked if each.path[0] == "roles"}
    return tuple(_measured(each, measured, roles) for each in asked)


def draft_note(*, steps: int, seed: int, declares: bool = False) -> str:
    """The comment at the top of a measured draft.

    Args:
        steps: played.
        seed: of the episode.
        declares: usual values are declared in it.
    """
    usual = "Lines without a # are declared: change what isn't meant."
    lines = (
        *([usual] if declares else []),
        f"A draft: values marked as measured come from {steps:,} steps with seed {seed}.",
        "They are not declarations. Only you know the intended game: remove the # from a line",
        "whose value is intended, and audits check the environment against it from then on.",
    )
    return "".join(f"## {line}\n" for line in lines) + "\n"


def _measured(question: Question, measured: Measured, roles: AbstractSet[str]) -> Question:
    value = _answer(question.path, measured, roles)
    if value is not None:
        return replace(question, measured=value_text(value))
    text = _hint(question.path, measured)
    if not text:
        return question
    text = text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
    return replace(question, hint="; ".join(filter(None, [question.hint, f"measured: {text}"])))


def _answer(path: tuple[str, ...], measured: Measured, roles: AbstractSet[str]) -> Any:
    """The measured value in the words of a contract; None where it doesn't answer the question.

    That no agent was seen to join or to leave is no answer, and roles may be called otherwise.
    """
    match path:
        case ("schedule", "stages"):
            stages = measured.get("stages") or []
            names = {name for stage in stages for name in stage}
            return stages if names and names <= roles else None
        case ("roles", role, ("may_join" | "may_leave") as key):
            return role in (measured.get(key) or ()) or None
        case ("seeds", "deterministic"):
            return _plain(measured.get("deterministic"), bool)
        case ("schedule", "horizon"):
            return None if near_horizon(measured) else _plain(measured.get("horizon"), int)
        case ("schedule", key) if key in WORDS:
            value = measured.get(key)
            return value if value in WORDS[key] else None
    return None


def _hint(path: tuple[str, ...], measured: Measured) -> str:
    """A measured value that helps with the answer; empty where there is none."""
    match path:
        case ("why",):
            return str(measured.get("why") or "")
        case ("roles", role, "symmetric"):
            by_role = measured.get("symmetric")
            return words(by_role.get(role)) if isinstance(by_role, Mapping) else ""
        case ("schedule", "horizon"):
            return near_horizon(measured)
        case ("schedule", "conflicts"):
            effect = ORDER_MATTERS.get(str(measured.get("order_sensitive")))
            return f"effect of the order of the action dictionary: {effect}" if effect else ""
        case ("rewards" | "endings" as section, _):
            return words(measured.get("reward" if section == "rewards" else section))
    return ""


def _plain(value: Any, kind: type) -> Any:
    """The value where it is of that type; a bool isn't taken for a number."""
    is_meant = kind is bool or not isinstance(value, bool)
    return value if isinstance(value, kind) and is_meant else None
