"""Summary of a run, agent by agent: never one averaged number."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.episodes.plain_json import fields_json
from gamekeeper.episodes.row_tables import html_table, text_lines

if TYPE_CHECKING:
    from gamekeeper.contract import Contract
    from gamekeeper.episodes.tables import Tables

FLAGS: Final = ("terminated", "truncated")
KEYS: Final = ("episode", "agent")
ENDED: Final = dict.fromkeys(FLAGS, "max")
ACTED: Final = {"order": "sum"}
"""By column, the function that makes one row of two of the same episode and agent."""
FOLD: Final = 64
"""Parts whose groups wait, before equal ones are made one."""


class Tally:
    """Sums over rows of `steps`, in whose order they are added.

    Args:
        noop_of: the declared noop of an agent; None where it has none.
    """

    def __init__(self, noop_of: Callable[[str], Any]) -> None:
        self._noop_of = noop_of
        self.returns: dict[str, float] = {}
        """By agent, the sum of its rewards; every agent that has a row stands in it."""
        self.idle: Counter[str] = Counter()
        """By agent, the number of its whole-number actions that were its noop."""
        self._pairs: list[pa.Table] = []
        self._acted: list[pa.Table] = []

    def add(self, steps: pa.Table) -> None:
        """The next rows."""
        self._pay(steps)
        self._pairs = _folded([*self._pairs, _grouped(steps, ENDED)], ENDED)
        ended = pc.or_(*(pc.fill_null(steps[name], False) for name in FLAGS))
        chose = pc.and_(pc.is_valid(steps["order"]), pc.is_null(steps["raised"]))
        acted = steps.filter(pc.and_(chose, pc.invert(ended)))
        self._acted = _folded([*self._acted, _grouped(acted, {"order": "count"})], ACTED)
        self._rest(acted)

    def pairs(self) -> pa.Table:
        """`episode`, `agent`: all that have a row; `terminated`, `truncated`: true if ever set."""
        return _one_table(self._pairs, ENDED)

    def acted(self) -> pa.Table:
        """`episode`, `agent`: all that acted while alive; `order`: number of their actions."""
        return _one_table(self._acted, ACTED)

    def _pay(self, steps: pa.Table) -> None:
        names = steps["agent"].combine_chunks().dictionary_encode()
        agents = names.dictionary.to_pylist()
        # One after the other: sums of floats in another order differ in their last digits.
        sums = np.array([self.returns.get(name, 0.0) for name in agents], np.float64)
        paid = np.asarray(pc.is_valid(steps["reward"])) & np.asarray(names.is_valid())
        rewards = pc.fill_null(steps["reward"], 0.0).to_numpy()
        codes = np.asarray(names.indices.fill_null(0))
        with np.errstate(
            over="ignore", invalid="ignore"
        ):  # infinite rewards are a check's to judge
            np.add.at(sums, codes[paid], rewards[paid])
        self.returns |= dict(zip(agents, sums.tolist(), strict=True))

    def _rest(self, acted: pa.Table) -> None:
        """Counts noops of agents whose role declares one and whose actions are whole numbers."""
        columns = [
            field.name
            for field in acted.schema
            if field.name.split("@")[0] == "action" and pa.types.is_integer(field.type)
        ]
        agents = pc.unique(acted["agent"]).to_pylist() if columns else []
        noops = zip(agents, map(self._noop_of, agents), strict=True)
        whole = {agent: noop for agent, noop in noops if isinstance(noop, int)}
        for column in columns if whole else ():
            rows = acted.filter(pc.is_valid(acted[column]))
            known = whole.keys() & set(pc.unique(rows["agent"]).to_pylist())
            self.idle.update(dict.fromkeys(known, 0))
            for noop in set(whole.values()):
                still = rows.filter(pc.equal(rows[column], noop))["agent"]
                for entry in still.value_counts().to_pylist():
                    if whole.get(entry["values"]) == noop:
                        self.idle[entry["values"]] += entry["counts"]


def _folded(tables: list[pa.Table], folds: Mapping[str, str]) -> list[pa.Table]:
    """Tables of groups; one in which equal groups are one, once there are many."""
    return tables if len(tables) < FOLD else [_one_table(tables, folds)]


def _one_table(tables: list[pa.Table], folds: Mapping[str, str]) -> pa.Table:
    """A row for each episode and agent in any of the tables."""
    if not tables:
        return pa.table({name: pa.nulls(0) for name in (*KEYS, *folds)})
    return _grouped(pa.concat_tables(tables), folds)


def _grouped(table: pa.Table, folds: Mapping[str, str]) -> pa.Table:
    """A row for each pair, with the names that the columns had."""
    groups = table.select([*KEYS, *folds]).group_by(list(KEYS), use_threads=False)
    found = groups.aggregate(list(folds.items()))
    return found.select([*KEYS, *map("_".join, folds.items())]).rename_columns([*KEYS, *folds])


_UNREAD: Final = (
    "obs",
    "action_mask",
    "info",
    "nonconforming",
    "cumulative_reward",
    "live",
    "digest",
)
"""Kinds of columns that a summary does without: a long run's take most of its time and memory."""


@dataclass(frozen=True, slots=True)
class AgentSummary:
    """One agent over all episodes of a run.

    Attributes:
        return_mean: mean over its episodes of the sum of its rewards.
        length_mean: mean over its episodes of the number of its actions.
        share: its part of the team's return; None where any return is negative or the sum is 0.
        idle: part of its actions that are the declared noop; None where none is declared.
        endings: number of its episodes by the reason of their end.
    """

    return_mean: float
    length_mean: float
    share: float | None
    idle: float | None
    endings: Mapping[str, int]

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return fields_json(self)


@dataclass(frozen=True, slots=True)
class Summary:
    """Episodes, turns, actions and seconds of a run, and each agent's part."""

    episodes: int
    turns: int
    agent_steps: int
    seconds: float
    agents: Mapping[str, AgentSummary]

    def to_json(self) -> dict[str, Any]:
        """Plain data, as `gamekeeper rollout --json` prints it."""
        return fields_json(self)

    def rows(self) -> list[list[str]]:
        """A heading and a row for each agent, as texts."""
        return [
            ["agent", "return", "length", "share", "idle", "endings"],
            *([name, *_texts(agent)] for name, agent in self.agents.items()),
        ]

    def __str__(self) -> str:
        return "\n".join(text_lines(self.rows(), right=range(1, 5)))

    def to_html(self) -> str:
        """A table for notebooks."""
        return html_table(self.rows(), caption=f"Agents over {self.episodes} episodes")


def summarise(
    tables: Tables, episodes: pa.Table, contract: Contract, agents: Sequence[str], *, turns: int
) -> Summary:
    """The summary of a run, from some of its rows at a time.

    Args:
        tables: the run's tables.
        episodes: the table of them that has a row for each episode.
        contract: says which action of an agent does nothing.
        agents: the run's, in its order; those without a row are left out.
        turns: env steps of all episodes.
    """
    tally = Tally(contract.noop_of)
    for steps in tables.all_parts("agent_steps", without=_UNREAD) or ():
        if steps.num_rows:
            tally.add(steps)
    present = [name for name in agents if name in tally.returns]
    shares = _shares({name: tally.returns[name] for name in present})
    pairs, acted = tally.pairs(), tally.acted()
    episodes_of, counts = Counter(pairs["agent"].to_pylist()), acted["order"].to_pylist()
    played = Counter(acted["agent"].to_pylist())
    lengths: Counter[str] = Counter()
    for name, count in zip(acted["agent"].to_pylist(), counts, strict=True):
        lengths[name] += count
    endings = _endings(episodes, pairs)
    timings = tables.all_parts("timings") or ()
    wall_ns = sum(pc.sum(part["wall_ns"]).as_py() or 0 for part in timings)
    by_agent = {
        name: AgentSummary(
            return_mean=tally.returns[name] / max(episodes_of[name], 1),
            length_mean=lengths[name] / max(played.get(name, 1), 1),
            share=shares[name],
            idle=tally.idle[name] / lengths[name] if name in tally.idle else None,
            endings=endings.get(name, {}),
        )
        for name in present
    }
    return Summary(
        episodes=episodes.num_rows,
        turns=turns,
        agent_steps=sum(counts),
        seconds=wall_ns / 1e9,
        agents=by_agent,
    )


def _shares(returns: Mapping[str, float]) -> dict[str, float | None]:
    total = sum(returns.values())
    if not total or not np.isfinite(total) or any(value < 0 for value in returns.values()):
        return dict.fromkeys(returns)
    return {name: value / total for name, value in returns.items()}


def _endings(episodes: pa.Table, flags: pa.Table) -> dict[str, dict[str, int]]:
    """Number of episodes by agent and reason of their end: its reason, else its flag or the end."""
    reasons = {
        row["episode"]: (json.loads(row["endings"]) if row["endings"] else {}, row["end"] or "open")
        for row in episodes.select(["episode", "endings", "end"]).to_pylist()
    }
    found: dict[str, Counter[str]] = {}
    for row in flags.to_pylist():
        named, end = reasons.get(row["episode"], ({}, "open"))
        named_reason = named.get(row["agent"]) if isinstance(named, dict) else None
        flag = next((name for name in FLAGS if row[name]), None)
        reason = str(named_reason or flag or ("left" if end == "ended" else end))
        found.setdefault(row["agent"], Counter())[reason] += 1
    return {agent: dict(sorted(counter.items())) for agent, counter in found.items()}


def _texts(agent: AgentSummary) -> list[str]:
    return [
        f"{agent.return_mean:.3f}",
        f"{agent.length_mean:.1f}",
        "-" if agent.share is None else f"{agent.share:.0%}",
        "-" if agent.idle is None else f"{agent.idle:.0%}",
        ", ".join(f"{reason} {count}" for reason, count in agent.endings.items()),
    ]
