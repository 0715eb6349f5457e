"""What checks of state() share: whether there is one, and places in a play."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from gamekeeper.core.contract import Contract
from gamekeeper.core.fact import Fact
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.where import Where


def stateless(contract: Contract, evidence: Gathered) -> str | None:
    """Why there is no state to judge; None where there is, or where nobody could look."""
    facts = list(evidence.facts("state", "state"))
    if not facts or any(fact.value["is_there"] for fact in facts):
        return None
    return "it has no state(), which is optional"


def space_of(evidence: Gathered, play: int) -> Mapping[str, Any]:
    """What the space says: `space`, `shape`, `dtype`."""
    facts = list(evidence.facts("state", "state"))
    own = [fact for fact in facts if fact.where.play == play] or facts
    return own[0].value if own else {"space": None, "shape": None, "dtype": None}


def answers(evidence: Gathered) -> Iterator[tuple[Fact, Mapping[str, Any]]]:
    """Every answer that state() gave or should have given, with the fact of its play."""
    for fact in evidence.facts("state", "states"):
        for answer in fact.value["answers"]:
            yield fact, answer


def forms(evidence: Gathered) -> Iterator[tuple[Fact, Mapping[str, Any]]]:
    """Every answer, and of rollouts, which are longer, the first one of each form."""
    yield from answers(evidence)
    if any(fact.value["is_there"] for fact in evidence.facts("state", "state")):
        for fact in evidence.facts("rollout", "states"):
            for answer in fact.value["answers"]:
                yield fact, answer


def at(fact: Fact, answer: Mapping[str, Any], field: str = "state") -> Where:
    """The place of an answer."""
    return replace(fact.where, turn=answer["turn"], field=field)
