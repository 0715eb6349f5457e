"""The figures of every episode and agent of a run, summed without a look at each row."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gamekeeper.core.arrow import TERM
from gamekeeper.core.canon import from_json
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.outcome import Outcome, failed, failures, outcome_of, plain_numbers
from gamekeeper.errors import ContractError, EvidenceError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

APART: Final = ("obs", "info", "mask", "received", "odd", "live", "action")
"""Kinds of columns that sums don't need."""
FIGURES: Final = frozenset({"return", "length", "is_over", "ending"})
"""Names in a failure condition that need no infos."""


@dataclass(frozen=True, slots=True)
class Figures:
    """What each episode came to, agent by agent.

    Attributes:
        headers: the rows of `episodes`.
        agents: in the order of their seats; only those with a row.
        present: [episodes, agents] the agent has a row in the episode.
        returns: [episodes, agents] the sum of its rewards.
        lengths: [episodes, agents] its actions, without the empty steps of those who ended.
        terms: by reward term, [episodes, agents].
        terminated: [episodes, agents] it was told so.
        truncated: [episodes, agents] it was told so.
    """

    headers: tuple[Mapping[str, Any], ...]
    agents: tuple[str, ...]
    present: BoolArray
    returns: FloatArray
    lengths: FloatArray
    terms: Mapping[str, FloatArray]
    terminated: BoolArray
    truncated: BoolArray
    _places: Mapping[int, int] = field(default_factory=dict)

    @property
    def team(self) -> FloatArray:
        """[episodes] the sum of all agents' returns."""
        return np.asarray(np.where(self.present, self.returns, 0.0).sum(axis=1), np.float64)

    def place(self, episode: int) -> int:
        """The row of an episode."""
        return self._places[episode]


def figures_of(evidence: Evidence) -> Figures:
    """The figures of a whole run, from one reading of its rows."""
    headers = tuple(evidence.episodes.to_pylist())
    steps = evidence.tables.table("steps", without=APART)
    if steps is None or not steps.num_rows:
        steps = evidence.steps
    known = set(pc.unique(steps["agent"]).to_pylist())
    agents = [name for name in map(str, evidence.manifest.get("agents") or ()) if name in known]
    agents += sorted(known - set(agents))
    rows = _Rows(steps, [header["episode"] for header in headers], agents)
    ended = rows.flag("terminated") | rows.flag("truncated")
    acted = rows.valid("order") & ~rows.valid("raised") & ~ended
    terms = [name for name in steps.schema.names if name.startswith(TERM)]
    return Figures(
        headers=headers,
        agents=tuple(agents),
        present=rows.counted(np.ones(steps.num_rows, np.bool_)) > 0,
        returns=rows.summed("reward"),
        lengths=rows.counted(acted),
        terms={name[len(TERM) :]: rows.summed(name) for name in terms},
        terminated=rows.counted(rows.flag("terminated")) > 0,
        truncated=rows.counted(rows.flag("truncated")) > 0,
        _places={header["episode"]: place for place, header in enumerate(headers)},
    )


class _Rows:
    """Rows with the place of their episode and agent, summed into [episodes, agents]."""

    def __init__(self, steps: pa.Table, episodes: list[int], agents: list[str]) -> None:
        self.steps = steps
        self.shape = (len(episodes), len(agents))
        order = np.argsort(np.asarray(episodes, np.int64), kind="stable")
        numbers = np.asarray(episodes, np.int64)[order]
        row = np.searchsorted(numbers, steps["episode"].to_numpy())
        row = order[np.minimum(row, max(len(order) - 1, 0))] if len(order) else row
        column = pc.index_in(steps["agent"], pa.array(agents, pa.string()))
        self.cell = row * max(len(agents), 1) + column.to_numpy().astype(np.int64)

    def flag(self, name: str) -> BoolArray:
        flags = pc.fill_null(self.steps[name], False)
        return np.asarray(flags.to_numpy(), np.bool_)

    def valid(self, name: str) -> BoolArray:
        return np.asarray(pc.is_valid(self.steps[name]).to_numpy(), np.bool_)

    def summed(self, name: str) -> FloatArray:
        return self._into(pc.fill_null(self.steps[name], 0.0).to_numpy())

    def counted(self, chosen: BoolArray) -> FloatArray:
        return self._into(chosen)

    def _into(self, weights: Any) -> FloatArray:
        size = self.shape[0] * self.shape[1]
        sums = np.bincount(self.cell, np.asarray(weights, np.float64), minlength=size)
        return np.asarray(sums[:size].reshape(self.shape), np.float64)


# -- failures


def failing(evidence: Evidence, figures: Figures) -> tuple[list[bool | None], str]:
    """Which episodes failed by the contract's conditions, and in words what those are.

    None of an episode for which it can't be told; an episode that an exception broke off failed.
    """
    contract = evidence.contract
    broken = [True if header.get("error") else None for header in figures.headers]
    try:
        conditions = failures(contract)
    except ContractError:
        return broken, "the contract names no failure; episodes that an error broke off failed"
    text = "; ".join(f"{scope}: {condition.text}" for scope, condition in conditions.items())
    names = {name.rpartition(".")[2] for each in conditions.values() for name in each.names}
    needs_infos = not names <= FIGURES | set(figures.terms) | set(contract.rewards)
    infos = _last_infos(evidence, figures) if needs_infos else {}
    found: list[bool | None] = []
    for place, header in enumerate(figures.headers):
        try:
            outcome = _outcome(figures, place, infos.get(header["episode"], {}))
            found.append(any(failed(outcome, conditions, contract).values()))
        except (ContractError, EvidenceError) as error:
            found.append(True if header.get("error") else None)
            text = f"{text} ({error.what})" if error.what not in text else text
    return found, text


def _outcome(
    figures: Figures, place: int, infos: Mapping[str, tuple[int, Mapping[str, float]]]
) -> Outcome:
    header = figures.headers[place]
    there = np.flatnonzero(figures.present[place]).tolist()
    names = [figures.agents[k] for k in there]
    told = _endings(header)
    return Outcome(
        seed=header.get("seed"),
        turns=header.get("turns") or 0,
        returns={figures.agents[k]: float(figures.returns[place, k]) for k in there},
        terms={
            figures.agents[k]: {name: float(sums[place, k]) for name, sums in figures.terms.items()}
            for k in there
        }
        if figures.terms
        else {},
        endings={
            name: str(told.get(name) or ending_word(figures, place, k) or "cut")
            for name, k in zip(names, there, strict=True)
        },
        infos={name: numbers for name, (_, numbers) in infos.items()},
        seen={name: turn for name, (turn, _) in infos.items()},
        flags={
            name: ending_word(figures, place, k) or "cut"
            for name, k in zip(names, there, strict=True)
        },
        is_over=header.get("end") == "ended",
        error=header.get("error"),
    )


def ending_word(figures: Figures, place: int, agent: int) -> str | None:
    """`terminated`, `truncated`, or None: what an agent of an episode was told."""
    if figures.terminated[place, agent]:
        return "terminated"
    return "truncated" if figures.truncated[place, agent] else None


def _endings(header: Mapping[str, Any]) -> Mapping[str, Any]:
    try:
        told = json.loads(header.get("endings") or "{}")
    except ValueError:
        return {}
    return told if isinstance(told, Mapping) else {}


def _last_infos(
    evidence: Evidence, figures: Figures
) -> dict[int, dict[str, tuple[int, Mapping[str, float]]]]:
    """By episode and agent, the turn and the numbers of the last info that had any."""
    steps = evidence.tables.table("steps", without=(*APART[:1], *APART[2:], "reward"))
    if steps is None or not steps.num_rows:
        return {}
    steps = steps.select(["episode", "turn", "agent", "info"])
    steps = steps.filter(pc.is_valid(steps["info"]))
    names = pc.index_in(steps["agent"], pa.array(figures.agents, pa.string())).to_numpy()
    key = steps["episode"].to_numpy().astype(np.int64) * max(len(figures.agents), 1) + names
    _, last = np.unique(key[::-1], return_index=True)
    rows = steps.take(pa.array(len(key) - 1 - last))
    found: dict[int, dict[str, tuple[int, Mapping[str, float]]]] = {}
    again: set[int] = set()
    for row in rows.to_pylist():
        numbers = plain_numbers(from_json(row["info"]))
        if numbers:
            found.setdefault(row["episode"], {})[row["agent"]] = (row["turn"], numbers)
        else:  # an earlier one may have had some
            again.add(row["episode"])
    for episode in again:
        outcome = outcome_of(evidence.trace(episode))
        found[episode] = {
            agent: (outcome.seen[agent], numbers) for agent, numbers in outcome.infos.items()
        }
    return found
