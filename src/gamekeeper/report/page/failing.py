"""Which episodes of a run failed, by the contract's conditions."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.core.canon import from_json
from gamekeeper.core.evidence import Evidence
from gamekeeper.core.outcome import (
    Outcome,
    failed,
    failures,
    outcome_of,
    plain_numbers,
)
from gamekeeper.errors import ContractError, EvidenceError
from gamekeeper.report.page.figures import APART, Figures

KNOWN: Final = frozenset({"return", "length", "is_over", "ending"})
"""Names in a failure condition that need no infos."""


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
    needs_infos = not names <= KNOWN | set(figures.terms) | set(contract.rewards)
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
            name: str(told.get(name) or _ending_word(figures, place, k) or "cut")
            for name, k in zip(names, there, strict=True)
        },
        infos={name: numbers for name, (_, numbers) in infos.items()},
        seen={name: turn for name, (turn, _) in infos.items()},
        flags={
            name: _ending_word(figures, place, k) or "cut"
            for name, k in zip(names, there, strict=True)
        },
        is_over=header.get("end") == "ended",
        error=header.get("error"),
    )


def _ending_word(figures: Figures, place: int, agent: int) -> str | None:
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
    found: dict[int, dict[str, tuple[int, Mapping[str, float]]]] = {}
    again: set[int] = set()
    for row in _last_rows(evidence, figures):
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


def _last_rows(evidence: Evidence, figures: Figures) -> Iterator[dict[str, Any]]:
    """The last row with an info of each agent in each episode, from some rows at a time."""
    names, open_yet = ["episode", "turn", "agent", "info"], None
    parts = evidence.tables.all_parts("steps", without=(*APART[:1], *APART[2:], "reward"))
    for part in parts or ():
        if not part.num_rows:
            continue
        rows = part.select(names)
        goes_on = part["episode"][-1]
        rows = rows.filter(pc.is_valid(rows["info"]))
        last = _last(rows if open_yet is None else pa.concat_tables([open_yet, rows]), figures)
        yield from last.filter(pc.not_equal(last["episode"], goes_on)).to_pylist()
        open_yet = last.filter(pc.equal(last["episode"], goes_on))
    yield from () if open_yet is None else open_yet.to_pylist()


def _last(rows: pa.Table, figures: Figures) -> pa.Table:
    """The last row of each agent in each episode."""
    names = pc.index_in(rows["agent"], pa.array(figures.agents, pa.string())).to_numpy()
    key = rows["episode"].to_numpy().astype(np.int64) * max(len(figures.agents), 1) + names
    _, last = np.unique(key[::-1], return_index=True)
    return rows.take(pa.array(len(key) - 1 - last))
