"""Turns at which everybody played legally, and what became of them. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from gamekeeper.audit.checks._endings import ended_in
from gamekeeper.audit.checks._masks import is_legal, mask_of
from gamekeeper.audit.checks._observations import spaces_of
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered, Look
from gamekeeper.core.trace import Trace, Turn


@dataclass(frozen=True, slots=True)
class Taken:
    """A turn at which live agents acted, all of them legally.

    Attributes:
        is_masked: a mask said to one of them what is legal.
        raised: what the step raised, in words; None where it was accepted.
    """

    trace: Trace
    turn: Turn
    agent: str
    is_masked: bool
    raised: str | None


def legal_turns(contract: Contract, evidence: Gathered) -> Iterator[Taken]:
    """Turns of rollouts at which live agents acted.

    Random play is legal by its making. Where a step raised, every turn is looked at, as the actions
    may come from elsewhere: then it is turns up to the first that isn't legal, or can't be judged.
    """
    known = spaces_of(evidence, "action")
    for look in evidence.looks.get("rollout", ()):
        raised = _raised(look)
        for trace in look.traces:
            for turn in trace.turns:
                ended = ended_in(turn)
                acting = [agent for agent in turn.order if agent not in ended]
                if not acting:
                    continue
                masks = {agent: mask_of(contract, turn, agent) for agent in acting}
                if raised and not all(_plays(known, turn, each, masks[each]) for each in acting):
                    break
                said = raised if turn.raised else None
                masked = any(mask is not None for mask in masks.values())
                yield Taken(trace, turn, acting[0], masked, said)


def _plays(known: dict[str, Any], turn: Turn, agent: str, mask: Any) -> bool:
    space, action = known.get(agent), turn.actions.get(agent)
    return space is not None and action is not None and is_legal(space, mask, action)


def _raised(look: Look) -> str | None:
    """What a step raised in this play, in words."""
    for fact in look.facts:
        if fact.name == "raised" and fact.value["call"] == "step":
            return f"{fact.value['kind']}: {fact.value['text']}"
    return None
