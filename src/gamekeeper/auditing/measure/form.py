"""Measured endings and length of episodes. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median
from typing import Any

from gamekeeper.checks.rounds import orders, ticks
from gamekeeper.episodes.episode import Episode


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
