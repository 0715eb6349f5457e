"""Whom the dictionaries of a Parallel environment speak of, turn by turn."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from gamekeeper.core.trace import Trace, Turn
from gamekeeper.core.where import Where

PARTS: Final = {
    "obs": "observations",
    "received": "rewards",
    "terminated": "terminations",
    "truncated": "truncations",
    "info": "infos",
}
"""What a row was given, and the dictionary where it stands."""
AT_RESET: Final = frozenset({"obs", "info"})


@dataclass(frozen=True, slots=True)
class Given:
    """One turn of a Parallel environment beside the one before.

    Attributes:
        turn: what was given at its start.
        before: the roster at the start of the turn before; empty after the reset.
        acted: who acted in the turn before.
        missing: parts that say nothing of an agent, by agent; only agents of whom any says.
    """

    turn: Turn
    before: frozenset[str]
    acted: frozenset[str]
    missing: dict[str, frozenset[str]]

    @property
    def all_parts(self) -> frozenset[str]:
        """The parts that were returned by the call."""
        return frozenset(PARTS) if self.turn.index else AT_RESET

    def has(self, agent: str) -> frozenset[str]:
        """The parts that say something of an agent in this turn."""
        return self.all_parts - self.missing.get(agent, frozenset())

    @property
    def says_nothing(self) -> bool:
        """No dictionary speaks of anybody: what was returned has another form."""
        return bool(self.turn.live) and not any(self.has(agent) for agent in self.turn.live)


def given(trace: Trace) -> Iterator[Given]:
    """The turns of a Parallel trace with what their dictionaries leave out."""
    before: frozenset[str] = frozenset()
    acted: frozenset[str] = frozenset()
    is_odd = has_odd_rows(trace)
    for turn in trace.turns:
        missing = {
            agent: frozenset(part for part in PARTS if odd.get(part, {}).get("type") == "missing")
            for agent, odd in (turn.odd.items() if is_odd else ())
        }
        if not turn.raised:
            yield Given(turn, before, acted, missing)
        before, acted = turn.live, frozenset(turn.order)


def has_odd_rows(trace: Trace) -> bool:
    """Whether anything in the trace isn't as it was declared; asking turns for it takes long."""
    return trace.steps["odd"].null_count < trace.steps.num_rows  # type: ignore[no-any-return]


def place(trace: Trace, turn: Turn, agent: str, part: str) -> Where:
    """Where an entry is missing; a reward belongs to the turn whose crossing paid it."""
    number = turn.index - 1 if part == "received" else turn.index
    return trace.at(number, agent, PARTS[part])
