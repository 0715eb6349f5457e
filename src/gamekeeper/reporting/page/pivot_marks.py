"""Pivots of an episode on its timeline: marks where success was lost, and the curve of success."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gamekeeper.reporting.page.packed_episode import Mark

Document = Mapping[str, Any]


def pivots_of(document: Document | None, episode: int) -> Document | None:
    """The part of `gamekeeper pivots --json` about an episode; None where there is none."""
    every = (document or {}).get("episodes") or ()
    return next((each for each in every if each["episode"] == episode), None)


def pivot_marks(found: Document) -> list[Mark]:
    """A mark for each pivot, of the agent whose action would have kept the success if it is one."""
    is_last = found["question"] == "last action"
    marks = []
    for pivot in found["pivots"]:
        agents = pivot["agents"]
        fall = f"success falls from {pivot['before']['share']:.0%} to {pivot['after']['share']:.0%}"
        text = "last turn at which another action succeeds" if is_last else fall
        if len(agents) > 1:
            text += f"; actions of {', '.join(agents)} would have kept it"
        elif pivot["loss"] == "draws":
            text += "; chance lost it"
        marks.append(Mark(pivot["turn"], "pivot", text, agents[0] if len(agents) == 1 else None))
    return marks


def success_curve(found: Document) -> list[list[float]]:
    """[turn, share, low, high] of each turn whose continuations were played."""
    return [[each[key] for key in ("turn", "share", "low", "high")] for each in found["curve"]]
