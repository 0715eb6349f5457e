"""The list of all episodes by numbers, and any one of them packed with all its marks."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from gamekeeper.core.evidence import Evidence
from gamekeeper.core.outcome import failed, failures, outcome_of
from gamekeeper.core.trace import Trace
from gamekeeper.errors import ContractError
from gamekeeper.report.page.drawing import Film, drawn
from gamekeeper.report.page.failing import failing
from gamekeeper.report.page.figures import Figures, figures_of
from gamekeeper.report.page.pack import Mark, Seat, packed_episode, seats_of, turns_of

Label = Mapping[str, Any]

MOST_AGENTS: Final = 64
"""Agents whose returns stand in the list; of more, only the sum."""


def entries_of(
    evidence: Evidence,
    *,
    run: str = "a",
    labels: Sequence[Label] = (),
    figures: Figures | None = None,
    failed: Sequence[bool | None] | None = None,
) -> list[dict[str, Any]]:
    """Every episode by its numbers, as the page's script lists them; none is on the page yet.

    Args:
        evidence: of the run; it may still be recorded.
        run: its letter.
        labels: failure labels as plain data.
        figures: of the run, where they are known already.
        failed: by episode, where it is known already.
    """
    figures = figures_of(evidence) if figures is None else figures
    failed = failing(evidence, figures)[0] if failed is None else failed
    has_few = len(figures.agents) <= MOST_AGENTS
    said: dict[Any, list[str]] = {}
    for each in labels:
        said.setdefault(each["episode"], []).append(str(each["label"]))
    team = figures.team
    return [
        {
            "run": run,
            "episode": header["episode"],
            "seed": header["seed"],
            "turns": _turns(evidence, header),
            "end": header["end"] or "open",
            "error": header["error"],
            "packed": False,
            "why": [],
            "failing": failed[place],
            "team": _finite(team[place]),
            "returns": {
                agent: _finite(figures.returns[place, column])
                for column, agent in enumerate(figures.agents)
                if has_few and figures.present[place, column]
            },
            "labels": list(dict.fromkeys(said.get(header["episode"], ()))),
            "base": None,
            "change": None,
        }
        for place, header in enumerate(figures.headers)
    ]


def listed(entries: Sequence[dict[str, Any]], *, most_bytes: int) -> list[dict[str, Any]]:
    """As many entries as fit: those on the page, then failing ones, then the others.

    Args:
        entries: in the order in which they are shown, which stays.
        most_bytes: of their JSON.
    """
    left, kept = most_bytes, set()
    for place in sorted(range(len(entries)), key=lambda k: _weight(entries[k])):
        left -= len(json.dumps(entries[place]))
        if left < 0 and not entries[place]["packed"]:
            break
        kept.add(place)
    return [entry for place, entry in enumerate(entries) if place in kept]


def _weight(entry: Mapping[str, Any]) -> tuple[bool, bool]:
    return not entry["packed"], not entry["failing"]


def _turns(evidence: Evidence, header: Mapping[str, Any]) -> int:
    """Of an episode that is still recorded, or was killed, as far as its rows tell."""
    told = header["turns"]
    return turns_of(evidence.trace_of(header)) if told is None else int(told)


def _finite(value: float) -> float | None:
    return float(f"{value:.7g}") if np.isfinite(value) else None


def packed_of(
    evidence: Evidence,
    episode: int,
    *,
    run: str = "a",
    labels: Sequence[Label] = (),
    marks: Iterable[Mark] = (),
    seats: Sequence[Seat] = (),
    frames: Film | None = None,
    has_failed: bool | None = None,
) -> dict[str, Any]:
    """One episode as the player reads it, with its drawing and all its marks.

    Args:
        evidence: of the run.
        episode: its number.
        run: the letter of the run.
        labels: failure labels of the run as plain data.
        marks: further ones, as where it parts from another.
        seats: of the run, where they are known already.
        frames: what was rendered while it was recorded.
        has_failed: whether it failed, where that is known already.
    Raises:
        KeyError: there is no such episode.
    """
    trace = evidence.trace(episode)
    seats = seats or seats_of(evidence)
    names = [seat.name for seat in seats]
    every = [*marks, *_label_marks(trace, labels), *_failure_marks(evidence, trace, has_failed)]
    return packed_episode(
        trace,
        seats,
        run=run,
        api=str((evidence.manifest.get("environment") or {}).get("api") or "parallel"),
        marks=every,
        drawing=lambda infos: drawn(trace, names, frames=frames, infos=infos),
    )


def _label_marks(trace: Trace, labels: Iterable[Label]) -> Iterable[Mark]:
    for each in labels:
        if each["episode"] == trace.episode:
            why = f": {each['why']}" if each.get("why") else ""
            yield Mark(int(each["turn"] or 0), "label", f"{each['label']}{why}", each["agent"])


def _failure_marks(evidence: Evidence, trace: Trace, has_failed: bool | None) -> Iterable[Mark]:
    """Whose condition the episode failed, at its end; an error has a mark of its own."""
    if trace.header.get("error") or has_failed is False:
        return
    try:
        conditions = failures(evidence.contract)
        if has_failed and len(conditions) == 1:  # whose it is needs no second look
            answers = dict.fromkeys(conditions, True)
        else:
            answers = failed(outcome_of(trace), conditions, evidence.contract)
    except ContractError:  # nothing is declared, or the episode lacks a figure
        return
    for scope, is_failed in answers.items():
        if is_failed:
            condition = conditions.get(scope)
            text = f"failed for {scope}" + ("" if condition is None else f": {condition.text}")
            yield Mark(turns_of(trace), "failure", text)
