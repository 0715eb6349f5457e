"""Penalties that the wrong participant pays, counted. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from gamekeeper.core.stats import Share, wilson


@dataclass(frozen=True, slots=True)
class Penalty:
    """What an agent paid under a term that its earner should pay.

    Attributes:
        agent: who paid.
        term: of the reward.
        wrong: share of the looks at which others' doing alone caused it, not the payer's.
        unknown: looks at which nobody's doing nothing alone would have spared it.
        by: how often each other agent caused it.
        first: the first wrong payment: episode, seed, turn, amount, who caused it.
    """

    agent: str
    term: str
    wrong: Share
    unknown: int
    by: Mapping[str, int]
    first: Mapping[str, Any] | None

    @property
    def is_wrong(self) -> bool:
        """It surely isn't always its own doing."""
        return self.first is not None

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "agent": self.agent, "term": self.term, "p": self.wrong.p, "low": self.wrong.low,
            "high": self.wrong.high, "n": self.wrong.n, "unknown": self.unknown,
            "by": dict(self.by), "first": None if self.first is None else dict(self.first),
        }  # fmt: skip


def penalties(scans: Iterable[Mapping[str, Any]]) -> list[Penalty]:
    """Who paid what under which term, and how often it was another's doing."""
    looks: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for each in scans:
        for look in each["penalties"]:
            at = {**look, "episode": each["number"]}
            looks.setdefault((look["agent"], look["term"]), []).append(at)
    return [_of(agent, term, mine) for (agent, term), mine in sorted(looks.items())]


def _of(agent: str, term: str, looks: list[Mapping[str, Any]]) -> Penalty:
    told = [look for look in looks if look["causers"]]
    wrong = [look for look in told if agent not in look["causers"]]
    by: dict[str, int] = {}
    for look in wrong:
        for name in look["causers"]:
            by[name] = by.get(name, 0) + 1
    first = min(wrong, key=lambda look: (look["episode"], look["turn"]), default=None)
    keys = ("episode", "seed", "turn", "paid", "causers")
    return Penalty(
        agent=agent,
        term=term,
        wrong=wilson(len(wrong), len(told)),
        unknown=len(looks) - len(told),
        by=dict(sorted(by.items())),
        first=None if first is None else {key: first[key] for key in keys},
    )
