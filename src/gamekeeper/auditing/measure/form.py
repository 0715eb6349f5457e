"""Measured endings and length of episodes. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median
from typing import Any

from gamekeeper.checks.rounds import orders
from gamekeeper.episodes.episode import Episode


def lengths(traces: Sequence[Episode]) -> list[int]:
    """Ticks of the episodes that ended by themselves."""
    return [len(orders(trace)) for trace in traces if trace.header.get("end") == "ended"]


def endings(traces: Sequence[Episode]) -> dict[str, Any]:
    """Number of episodes in which each agent terminated, truncated, or was cut.

    `both` counts the episodes in which an agent did both: it counts as each of them.
    """
    by_agent: dict[str, dict[str, int]] = {}
    both = 0
    for trace in traces:
        ends = _ends(trace)
        both += any(len(kinds) > 1 for kinds in ends.values())
        for agent, kinds in ends.items():
            counts = by_agent.setdefault(agent, {"terminated": 0, "truncated": 0, "open": 0})
            for kind in kinds or {"open"}:
                counts[kind] += 1
    ended = lengths(traces)
    return {
        "episodes": len(traces),
        "ended": len(ended),
        "both": both,
        "by_agent": dict(sorted(by_agent.items())),
        "ticks": None
        if not ended
        else {"least": min(ended), "median": median(ended), "most": max(ended)},
    }


def _ends(trace: Episode) -> dict[str, set[str]]:
    """Flags of each agent; none of one that was left when the episode was cut."""
    found: dict[str, set[str]] = {}
    for turn in trace.turns:
        for agent in turn.agents:
            flags = {"terminated": turn.terminated, "truncated": turn.truncated}
            raised = {kind for kind, each in flags.items() if each.get(agent)}
            if raised or agent in turn.live:
                found.setdefault(agent, set()).update(raised)
    return found
