"""Policies that raised, or gave no legal action, in new episodes: said before any experiment."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

from gamekeeper.diagnosis.plain_data import PlainData
from gamekeeper.episodes.outcome import Outcome
from gamekeeper.errors import ActionError, PolicyError
from gamekeeper.interface.packing import type_name_of

KINDS: Final = tuple(f"{type_name_of(kind)}: " for kind in (PolicyError, ActionError))
MOST: Final = 0.5
"""Part of the failed episodes from which nothing else is looked for."""


@dataclass(frozen=True, slots=True)
class RaisedPolicy(PlainData):
    """A policy that broke episodes off.

    Attributes:
        said: the first error, in words.
        turns: the first and the last turn at which it did so.
        count, episodes: how many episodes it broke off, and of how many.
    """

    agent: str
    said: str
    turns: tuple[int, int]
    count: int
    episodes: int

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {**PlainData.to_json(self), "text": str(self)}

    def __str__(self) -> str:
        first, last = self.turns
        where = f"at turn {first}" if first == last else f"at turns {first} to {last}"
        of = f"in {self.count} of {self.episodes} new episodes"
        return f"{self.agent}'s policy broke off {where} {of}: {self.said}"


def raised_in(outcomes: Iterable[Outcome]) -> tuple[RaisedPolicy, ...]:
    """The policies that broke episodes off, by agent, those of most episodes first."""
    every = list(outcomes)
    by_agent: dict[str, list[Outcome]] = {}
    for each in every:
        if each.error is not None and each.error.startswith(KINDS):
            named = [x for x in each.returns if f"for {x!r}" in each.error]
            by_agent.setdefault(named[0] if named else "an agent", []).append(each)
    found = [
        RaisedPolicy(
            agent,
            " ".join(str(mine[0].error).partition(": ")[2].partition(" where: ")[0].split()),
            (min(each.turns for each in mine), max(each.turns for each in mine)),
            len(mine),
            len(every),
        )
        for agent, mine in by_agent.items()
    ]
    return tuple(sorted(found, key=lambda each: -each.count))
