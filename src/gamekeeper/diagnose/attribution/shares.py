"""What each agent was paid itself, by term; its share and its idle part. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from gamekeeper.core.outcome import Outcome
from gamekeeper.core.summary import Summary


@dataclass(frozen=True, slots=True)
class Own:
    """What one agent was paid in the recorded run.

    Attributes:
        value: mean over its episodes of the sum of its rewards.
        terms: the same by reward term; empty where the run doesn't tell terms.
        share: its part of the team's return; None where signs mix or the sum is 0.
        idle: part of its actions that are the declared noop; None where none is declared.
    """

    value: float
    terms: dict[str, float]
    share: float | None
    idle: float | None

    def to_json(self) -> dict[str, Any]:
        """Plain data, as it stands in an agent's entry."""
        return {"own": self.value, "terms": self.terms, "share": self.share, "idle": self.idle}


def own_rewards(summary: Summary, outcomes: Iterable[Outcome]) -> dict[str, Own]:
    """What each agent of a run was paid, was idle, and had of the team's return."""
    sums: dict[str, dict[str, float]] = {}
    episodes: dict[str, int] = {}
    for outcome in outcomes:
        for agent in outcome.returns:
            episodes[agent] = episodes.get(agent, 0) + 1
            mine = sums.setdefault(agent, {})
            for term, value in outcome.terms.get(agent, {}).items():
                mine[term] = mine.get(term, 0.0) + value
    return {
        agent: Own(
            value=of.return_mean,
            terms={t: value / episodes[agent] for t, value in sums.get(agent, {}).items()},
            share=of.share,
            idle=of.idle,
        )
        for agent, of in summary.agents.items()
    }
