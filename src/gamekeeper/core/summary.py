"""What a run comes to, agent by agent: never one averaged number."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.core.tally import Tally

if TYPE_CHECKING:
    from gamekeeper.core.evidence import Evidence


_UNREAD: Final = ("obs", "mask", "info", "odd", "received", "live", "digest")
"""Kinds of columns that a summary does without: a long run's take most of its time and memory."""


@dataclass(frozen=True, slots=True)
class AgentSummary:
    """One agent over all episodes of a run.

    Attributes:
        return_mean: mean over its episodes of the sum of its rewards.
        length_mean: mean over its episodes of the number of its actions.
        share: its part of the team's return; None where signs mix or the sum is 0.
        idle: part of its actions that are the declared noop; None where none is declared.
        endings: how often it ended for each reason.
    """

    return_mean: float
    length_mean: float
    share: float | None
    idle: float | None
    endings: Mapping[str, int]

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "return_mean": self.return_mean,
            "length_mean": self.length_mean,
            "share": self.share,
            "idle": self.idle,
            "endings": dict(self.endings),
        }


@dataclass(frozen=True, slots=True)
class Summary:
    """Episodes, turns, actions and seconds of a run, and each agent's part."""

    episodes: int
    turns: int
    agent_steps: int
    seconds: float
    agents: Mapping[str, AgentSummary]

    def to_json(self) -> dict[str, Any]:
        """Plain data, as the `record` document has it."""
        return {
            "episodes": self.episodes,
            "turns": self.turns,
            "agent_steps": self.agent_steps,
            "seconds": self.seconds,
            "agents": {name: agent.to_json() for name, agent in self.agents.items()},
        }

    def rows(self) -> list[list[str]]:
        """A heading and a row for each agent, as texts."""
        head = ["agent", "return", "length", "share", "idle", "endings"]
        return [head, *([name, *_texts(agent)] for name, agent in self.agents.items())]

    def __str__(self) -> str:
        rows = self.rows()
        widths = [max(len(row[place]) for row in rows) for place in range(len(rows[0]))]
        return "\n".join(
            "  ".join(
                text.ljust(width) if place in (0, 5) else text.rjust(width)
                for place, (text, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in rows
        )

    def to_html(self) -> str:
        """A table for notebooks."""
        head, *rows = self.rows()
        heading = "".join(f"<th>{escape(text)}</th>" for text in head)
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows
        )
        return f"<table><thead><tr>{heading}</tr></thead><tbody>{body}</tbody></table>"


def summarise(evidence: Evidence) -> Summary:
    """The summary of a run, from some of its rows at a time."""
    tally = Tally(evidence.contract.noop_of)
    parts = evidence.tables.all_parts("steps", without=_UNREAD)
    for steps in parts or ():
        if steps.num_rows:
            tally.add(steps)
    seated = [name for name in evidence.manifest.get("agents", []) if name in tally.returns]
    shares = _shares({name: tally.returns[name] for name in seated})
    pairs, acted = tally.pairs(), tally.acted()
    present, counts = Counter(pairs["agent"].to_pylist()), acted["order"].to_pylist()
    played = Counter(acted["agent"].to_pylist())
    lengths: Counter[str] = Counter()
    for name, count in zip(acted["agent"].to_pylist(), counts, strict=True):
        lengths[name] += count
    endings = _endings(evidence, pairs)
    agents = {
        name: AgentSummary(
            return_mean=tally.returns[name] / max(present[name], 1),
            length_mean=lengths[name] / max(played.get(name, 1), 1),
            share=shares[name],
            idle=tally.idle[name] / lengths[name] if name in tally.idle else None,
            endings=endings.get(name, {}),
        )
        for name in seated
    }
    return Summary(
        episodes=evidence.episodes.num_rows,
        turns=pc.sum(evidence.episodes["turns"]).as_py() or 0,
        agent_steps=sum(counts),
        seconds=_seconds(evidence),
        agents=agents,
    )


def _seconds(evidence: Evidence) -> float:
    parts = evidence.tables.all_parts("timings")
    return sum(pc.sum(part["wall_ns"]).as_py() or 0 for part in parts or ()) / 1e9


def _shares(returns: Mapping[str, float]) -> dict[str, float | None]:
    total = sum(returns.values())
    same_sign = all(value >= 0 for value in returns.values()) or all(
        value <= 0 for value in returns.values()
    )
    if not same_sign or not total or not np.isfinite(total):
        return dict.fromkeys(returns)
    return {name: value / total for name, value in returns.items()}


def _endings(evidence: Evidence, flags: pa.Table) -> dict[str, dict[str, int]]:
    """How the episodes of each agent ended: its reason, else its flag, else how the episode did."""
    reasons = {
        row["episode"]: (json.loads(row["endings"]) if row["endings"] else {}, row["end"] or "cut")
        for row in evidence.episodes.select(["episode", "endings", "end"]).to_pylist()
    }
    found: dict[str, Counter[str]] = {}
    for row in flags.to_pylist():
        named, end = reasons.get(row["episode"], ({}, "cut"))
        named_reason = named.get(row["agent"]) if isinstance(named, dict) else None
        reason = str(named_reason or _flag(row) or ("left" if end == "ended" else end))
        found.setdefault(row["agent"], Counter())[reason] += 1
    return {agent: dict(sorted(counter.items())) for agent, counter in found.items()}


def _flag(row: Mapping[str, Any]) -> str | None:
    if row["terminated"]:
        return "terminated"
    return "truncated" if row["truncated"] else None


def _texts(agent: AgentSummary) -> list[str]:
    return [
        f"{agent.return_mean:.3f}",
        f"{agent.length_mean:.1f}",
        "-" if agent.share is None else f"{agent.share:.0%}",
        "-" if agent.idle is None else f"{agent.idle:.0%}",
        ", ".join(f"{reason} {count}" for reason, count in agent.endings.items()),
    ]
