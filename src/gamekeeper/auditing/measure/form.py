"""Measured schedule, endings and length of episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from statistics import median
from typing import Any

from gamekeeper.checks.rounds import FIXED, kind_of_order, orders, ticks
from gamekeeper.episodes.episode import Episode


def schedule(traces: Sequence[Episode], api: str) -> dict[str, Any] | None:
    """Schedule: agents act together or in turns, and the order of the turns.

    `acts`: `together` or `in turns`; `order`: `none`, `fixed`, `rotating`, `random`
    (fixed in an episode, not from one to the next) or `other`, None where no tick had two agents;
    `rounds` how many were looked at.
    """
    rounds = [orders(trace) for trace in traces]
    count = sum(map(len, rounds))
    if not count:
        return None
    sizes = Counter(len(each) for played in rounds for each in played)
    found = {"rounds": count, "most_in_a_round": max(sizes), "fewest_in_a_round": min(sizes)}
    if api == "parallel":
        return {"acts": "together", "order": "none", **found}
    kinds = {kind_of_order(played) for played in rounds if played} - {None}
    kind = next(iter(kinds)) if len(kinds) == 1 else ("other" if kinds else None)
    if kind == FIXED and kind_of_order([each for played in rounds for each in played]) != FIXED:
        kind = "random"  # settled at each reset
    return {"acts": "in turns", "order": kind, **found}


def lengths(traces: Sequence[Episode], api: str) -> list[int]:
    """Ticks of the episodes that ended by themselves."""
    return [
        len(orders(trace)) if api == "parallel" else len(ticks(trace))
        for trace in traces
        if trace.header.get("end") == "ended"
    ]


def endings(traces: Sequence[Episode], api: str) -> dict[str, Any]:
    """Number of episodes in which each agent terminated, truncated, or was cut."""
    by_agent: dict[str, dict[str, int]] = {}
    for trace in traces:
        for agent, how in _ends(trace).items():
            counts = by_agent.setdefault(agent, {"terminated": 0, "truncated": 0, "open": 0})
            counts[how] += 1
    ended = lengths(traces, api)
    return {
        "episodes": len(traces),
        "ended": len(ended),
        "by_agent": dict(sorted(by_agent.items())),
        "ticks": None
        if not ended
        else {"least": min(ended), "median": median(ended), "most": max(ended)},
    }


def _ends(trace: Episode) -> dict[str, str]:
    found: dict[str, str] = {}
    for turn in trace.turns:
        for agent in turn.agents:
            if turn.terminated.get(agent):
                found[agent] = "terminated"
            elif turn.truncated.get(agent):
                found.setdefault(agent, "truncated")
            elif found.get(agent) is None and agent in turn.live:
                found.setdefault(agent, "open")
            if found.get(agent) == "open" and turn.truncated.get(agent):
                found[agent] = "truncated"
    return found
