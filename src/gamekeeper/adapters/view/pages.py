"""What is served of a run, made by the report's page: the page, lines of the index, episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow.compute as pc

from gamekeeper.adapters.view.answers import Answer, page_answer
from gamekeeper.core.evidence import Evidence
from gamekeeper.report.page.drawing import drawn
from gamekeeper.report.page.pack import packed_episode, seats_of

if TYPE_CHECKING:
    from gamekeeper.adapters.view.book import Edition


def page_of(editions: Sequence[tuple[str, Path, Edition]]) -> Answer:
    """The page of these runs, which asks for the index and for episodes by itself."""
    return page_answer("<p>runs</p>", title="Gamekeeper")


def run_entry(edition: Edition, *, key: str, path: Path) -> dict[str, Any]:
    """One run's line in the index."""
    manifest = edition.evidence.manifest
    return {
        "key": key,
        "name": path.name,
        "status": edition.status,
        "episodes": len(edition.entries),
        "api": str((manifest.get("environment") or {}).get("api") or "parallel"),
    }


def packed_of(edition: Edition, number: int, *, run: str) -> dict[str, Any]:
    """One episode as the player reads it."""
    evidence = edition.evidence
    trace = evidence.trace(number)
    seats = seats_of(evidence)
    return packed_episode(
        trace,
        seats,
        run=run,
        api=str((evidence.manifest.get("environment") or {}).get("api") or "parallel"),
        drawing=drawn(trace, [seat.name for seat in seats]),
    )


def entries_of(
    evidence: Evidence, *, run: str, labels: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """The line of every episode in the index."""
    steps = evidence.tables.table("steps", without=("obs", "info", "action", "mask", "odd"))
    returns: dict[int, dict[str, float]] = {}
    turns: dict[int, int] = {}
    if steps is not None:
        found = steps.group_by(["episode", "agent"]).aggregate([("reward", "sum")]).to_pydict()
        for episode, agent, total in zip(*found.values(), strict=True):
            returns.setdefault(episode, {})[agent] = total or 0.0
        acted = steps.filter(pc.is_valid(steps["order"]))
        last = acted.group_by("episode").aggregate([("turn", "max")]).to_pydict()
        turns = {e: t + 1 for e, t in zip(*last.values(), strict=True)}
    return [
        {
            "run": run,
            "episode": row["episode"],
            "seed": row["seed"],
            "turns": row["turns"] if row["turns"] is not None else turns.get(row["episode"], 0),
            "end": row["end"] or "open",
            "error": row["error"],
            "packed": True,
            "why": [],
            "failing": None,
            "team": sum(returns.get(row["episode"], {}).values()),
            "returns": dict(sorted(returns.get(row["episode"], {}).items())),
            "labels": [e["label"] for e in labels if e["episode"] == row["episode"]],
            "base": None,
            "change": None,
        }
        for row in evidence.episodes.to_pylist()
    ]
