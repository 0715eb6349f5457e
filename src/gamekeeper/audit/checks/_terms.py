"""What each crossing paid by declared reward term."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.trace import Trace, Turn

PRECISION: Final = 1e-9
"""Of the sum of absolute values: terms are added up in float64."""


@dataclass(frozen=True, slots=True)
class Paid:
    """What one crossing paid.

    Attributes:
        trace: of which play.
        turn: which crossing.
        terms: by term, then by agent; an agent that isn't named was paid 0.
        payable: agents that were live and hadn't ended before it.
    """

    trace: Trace
    turn: Turn
    terms: Mapping[str, Mapping[str, float]]
    payable: frozenset[str]


def all_paid(contract: Contract, evidence: Gathered) -> Iterator[Paid]:
    """Every crossing by term: as the environment tells its terms, or the only one there is."""
    only = next(iter(contract.rewards)) if len(contract.rewards) == 1 else None
    for trace in evidence["rollout"]:
        live: set[str] = set()
        for turn in trace.turns:
            live = set(turn.live) if evidence.api == "parallel" else _now(live, turn)
            if not turn.order or any("reward" in fields for fields in turn.odd.values()):
                continue
            by_term: dict[str, dict[str, float]] = {}
            for agent, terms in turn.terms.items():
                for name, value in terms.items():
                    by_term.setdefault(name, {})[agent] = value
            if not by_term and only is not None:
                by_term = {only: dict(turn.rewards)}
            if by_term:
                yield Paid(trace, turn, by_term, frozenset(live - turn.ended))
            live -= turn.ended


def is_zero(value: float, scale: float) -> bool:
    """Zero but for what rounding leaves; `scale` is the sum of absolute values."""
    return abs(value) <= PRECISION * max(scale, 1.0)


def _now(live: set[str], turn: Turn) -> set[str]:
    """The roster of an AEC turn: rows stand only for those who acted, were paid or changed."""
    gone = {agent for agent in turn.agents if agent not in turn.live}
    begun = set(turn.live) if turn.index == 0 else turn.live - turn.ended
    return (live | begun) - gone
