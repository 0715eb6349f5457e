"""Measured rewards: sums, signs, shared by all agents, cancelling out."""

from collections.abc import Sequence
from typing import Any, Final

from gamekeeper.episodes.episode import Episode

LEAST: Final = 5
"""Steps that paid anything, for a word on whether rewards are shared or cancel out."""
CLOSE: Final = 1e-9


def payments(episodes: Sequence[Episode], api: str) -> dict[str, Any]:
    """Per agent what was paid, and whether steps paid all alike or sum to zero.

    `shared` and `zero_sum` are None where fewer than five steps paid anything, or only one
    agent plays; `n` counts the steps that paid.
    """
    by_agent: dict[str, dict[str, float]] = {}
    shared = zero = paid = 0
    most = 0
    for episode in episodes:
        roster = frozenset[str]()
        for turn in episode.turns:
            # a tick has a row for every live agent, a turn for those alone that something befell
            roster = turn.live if api == "parallel" else (roster - turn.ended) | turn.live
            if not turn.order:
                continue
            names = roster | frozenset(turn.rewards)
            most = max(most, len(names))
            for agent in turn.rewards:
                _count(by_agent, agent, turn.rewards[agent])
            if any(turn.rewards.values()):
                paid += 1
                amounts = [turn.rewards.get(name, 0.0) for name in names]
                shared += max(amounts) - min(amounts) <= CLOSE * max(map(abs, amounts))
                zero += abs(sum(amounts)) <= CLOSE * sum(map(abs, amounts))
    return {
        "by_agent": {
            agent: {"mean_return": entry.pop("sum") / max(len(episodes), 1), **entry}
            for agent, entry in sorted(by_agent.items())
        },
        "shared": shared == paid if paid >= LEAST and most > 1 else None,
        "zero_sum": zero == paid if paid >= LEAST and most > 1 else None,
        "n": paid,
    }


def _count(by_agent: dict[str, dict[str, float]], agent: str, amount: float) -> None:
    entry = by_agent.setdefault(
        agent, {"sum": 0.0, "least": amount, "most": amount, "positive": 0, "negative": 0}
    )
    entry["sum"] += amount
    entry["positive"] += amount > 0
    entry["negative"] += amount < 0
    entry["least"], entry["most"] = min(entry["least"], amount), max(entry["most"], amount)
