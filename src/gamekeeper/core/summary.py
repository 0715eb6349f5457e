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
    """The summary of a run."""
    steps = evidence.tables.table("steps", without=_UNREAD)
    steps = evidence.steps if steps is None else steps
    names = _agents(evidence, steps)
    returns = _by_agent(steps, "reward", "sum")
    acted = steps.filter(pc.and_(pc.is_valid(steps["order"]), pc.is_null(steps["raised"])))
    ended = pc.or_(
        pc.fill_null(acted["terminated"], False), pc.fill_null(acted["truncated"], False)
    )
    acted = acted.filter(pc.invert(ended))
    counts = _by_agent(acted, "order", "count")
    shares = _shares({name: returns.get(name, (0.0, 1))[0] for name in names})
    idle = _idle(evidence, acted)
    endings = _endings(evidence, steps)
    agents = {}
    for name in names:
        total, episodes = returns.get(name, (0.0, 1))
        agents[name] = AgentSummary(
            return_mean=total / max(episodes, 1),
            length_mean=counts.get(name, (0, 1))[0] / max(episodes, 1),
            share=shares[name],
            idle=idle.get(name),
            endings=endings.get(name, {}),
        )
    turns = evidence.episodes["turns"]
    timings = evidence.timings
    nanoseconds = 0 if timings is None else pc.sum(timings["wall_ns"]).as_py() or 0
    return Summary(
        episodes=evidence.episodes.num_rows,
        turns=pc.sum(turns).as_py() or 0,
        agent_steps=acted.num_rows,
        seconds=nanoseconds / 1e9,
        agents=agents,
    )


def _agents(evidence: Evidence, steps: pa.Table) -> list[str]:
    """The agents that have rows, in the order in which the run seated them."""
    present = set(pc.unique(steps["agent"]).to_pylist())
    return [name for name in evidence.manifest.get("agents", []) if name in present]


def _by_agent(table: pa.Table, column: str, how: str) -> dict[str, tuple[Any, int]]:
    """An aggregate of `column` by agent, and in how many episodes the agent stands."""
    # By one thread: sums of floats in another order differ in their last digits.
    grouped = table.select(["agent", "episode", column]).group_by("agent", use_threads=False)
    result = grouped.aggregate([(column, how), ("episode", "count_distinct")]).to_pydict()
    parts = result[f"{column}_{how}"], result["episode_count_distinct"]
    return {
        agent: (value or 0, episodes)
        for agent, value, episodes in zip(result["agent"], *parts, strict=True)
    }


def _shares(returns: Mapping[str, float]) -> dict[str, float | None]:
    total = sum(returns.values())
    same_sign = all(value >= 0 for value in returns.values()) or all(
        value <= 0 for value in returns.values()
    )
    if not same_sign or not total or not np.isfinite(total):
        return dict.fromkeys(returns)
    return {name: value / total for name, value in returns.items()}


def _idle(evidence: Evidence, acted: pa.Table) -> dict[str, float]:
    """The part of noops, for agents whose role declares one and whose actions are whole numbers."""
    columns = [
        field.name
        for field in acted.schema
        if field.name.split("@")[0] == "action" and pa.types.is_integer(field.type)
    ]
    counts = {agent: count for agent, (count, _) in _by_agent(acted, "order", "count").items()}
    noops = {agent: evidence.contract.noop_of(agent) for agent in counts}
    whole = {agent: noop for agent, noop in noops.items() if isinstance(noop, int)}
    idle: Counter[str] = Counter()
    for column in columns:
        rows = acted.filter(pc.is_valid(acted[column]))
        idle.update(dict.fromkeys(whole.keys() & set(pc.unique(rows["agent"]).to_pylist()), 0))
        for noop in set(whole.values()):
            still = rows.filter(pc.equal(rows[column], noop))
            for agent, (count, _) in _by_agent(still, "order", "count").items():
                if whole.get(agent) == noop:
                    idle[agent] += count
    return {agent: count / counts[agent] for agent, count in idle.items()}


def _endings(evidence: Evidence, steps: pa.Table) -> dict[str, dict[str, int]]:
    """How the episodes of each agent ended: its reason, else its flag, else how the episode did."""
    steps = steps.select(["episode", "agent", "terminated", "truncated"])
    flags = steps.group_by(["episode", "agent"], use_threads=False).aggregate(
        [("terminated", "max"), ("truncated", "max")]
    )
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
    if row["terminated_max"]:
        return "terminated"
    return "truncated" if row["truncated_max"] else None


def _texts(agent: AgentSummary) -> list[str]:
    return [
        f"{agent.return_mean:.3f}",
        f"{agent.length_mean:.1f}",
        "-" if agent.share is None else f"{agent.share:.0%}",
        "-" if agent.idle is None else f"{agent.idle:.0%}",
        ", ".join(f"{reason} {count}" for reason, count in agent.endings.items()),
    ]
