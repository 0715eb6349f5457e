"""The report: runs and what was found out about them, as one page in one file."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from gamekeeper.adapters.paging.documents import Given, PathText, documents_of
from gamekeeper.adapters.paging.opening import opened
from gamekeeper.adapters.paging.packer import LETTERS, Packer
from gamekeeper.adapters.paging.pictures import Pictures
from gamekeeper.adapters.paging.put import put
from gamekeeper.adapters.paging.twins import twins_of
from gamekeeper.core.legible import legible
from gamekeeper.errors import EvidenceError
from gamekeeper.record.files.folder import system_error
from gamekeeper.report.page.choose import BUDGET_BYTES, Budget, chosen_text, order_of
from gamekeeper.report.page.compose import (
    Documents,
    Pair,
    Shown,
    lead_of,
    pairs_of,
    sections_of,
)
from gamekeeper.report.page.data import Page
from gamekeeper.report.page.entries import MOST_AGENTS, listed
from gamekeeper.report.page.render import render

__all__ = ["Pictures", "documents_of", "opened", "report"]

FRAMES_BYTES: Final = 8_000_000
"""Of recorded pictures on a page, beside its data."""
MOST_PAIRS: Final = 12
"""Episodes of two runs that are compared."""
MOST_TWINS: Final = 3
"""Of each remedy."""
LIST_BYTES: Final = 300_000
"""Of the list of all episodes by numbers."""
ENTRY_BYTES: Final = 220
RETURN_BYTES: Final = 24
"""About what an episode takes in that list, and in it an agent's return."""
SEED: Final = 0
"""Of the resamples behind intervals: a page of the same evidence is the same page."""


def report(
    run: PathText,
    out: PathText = "report.html",
    *,
    others: Iterable[PathText] = (),
    audit: Given = None,
    diagnosis: Given = None,
    attribution: Given = None,
    evaluation: Given = None,
    episodes: Iterable[int] = (),
    budget_bytes: int = BUDGET_BYTES,
    frames_bytes: int = FRAMES_BYTES,
    title: str | None = None,
) -> Path:
    """Writes one self-contained page about a run, from whatever is known of it.

    A diagnosis and an attribution are found in the run's own annotations, where their commands put
    them. What isn't known is named on the page with the command that finds it out.

    Args:
        run: the folder of the run that the page is about.
        out: the file to write; it is whole or not there.
        others: runs that are put beside it.
        audit: what `gamekeeper audit --json` printed, or the file of it.
        diagnosis: another one than the run's last.
        attribution: another one than the run's last.
        evaluation: `evaluation.json` of `gamekeeper evaluate`, or its folder.
        episodes: numbers of those that must be on the page.
        budget_bytes: of episodes on the page; the others stand there by their numbers.
        frames_bytes: of recorded pictures.
        title: of the page; None: the name of the run.
    Returns:
        The file.
    Raises:
        BundleError: a run is missing or damaged, or the file can't be written.
        EvidenceError: a document isn't one, or a named episode isn't in the run.
    """
    paths = [Path(run), *map(Path, others)]
    if len(paths) > len(LETTERS):
        raise EvidenceError(
            "too many runs for one page",
            where="others", expected=f"at most {len(LETTERS)}", seen=str(len(paths)),
        )  # fmt: skip
    runs = [opened(path, key=key) for key, path in zip(LETTERS, paths, strict=False)]
    documents = documents_of(
        paths[0], audit=audit, diagnosis=diagnosis, attribution=attribution, evaluation=evaluation
    )
    page = _page(
        runs, documents, title=title, named=tuple(episodes), budget=Budget(budget_bytes),
        frames=Budget(frames_bytes), twins=tuple(twins_of(paths[0], runs[0], documents.diagnosis)),
    )  # fmt: skip
    target = Path(out)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise system_error("making the folder", target.parent, error) from error
    put(target, render(page).encode())
    return target


def _version() -> str:
    # the front stands above all layers, so nobody imports it
    return str(sys.modules["gamekeeper"].__version__)


@legible
def _page(
    runs: Sequence[Shown],
    documents: Documents,
    *,
    title: str | None,
    named: tuple[int, ...],
    budget: Budget,
    frames: Budget,
    twins: Sequence[Shown],
) -> Page:
    main = runs[0]
    pairs = _pairs(runs, twins)
    order = order_of(
        main.figures,
        failing=main.failed,
        named=named,
        labelled=[each["episode"] for each in main.labels if each["episode"] is not None],
        diverging=_diverging(documents, pairs, main),
    )
    budget.left -= min(_list_size(main), LIST_BYTES)  # the list of all episodes is data too
    packer = Packer([*runs, *twins], pairs, budget, frames, documents)
    taken = packer.fill(main, order)
    every = [entry for run in (*runs, *twins) for entry in packer.entries(run)]
    entries = listed(_in_order(every, main, [number for number, _ in order]), most_bytes=LIST_BYTES)
    chosen = chosen_text(taken, len(main.figures.headers), run=main.path)
    if len(entries) < len(every):
        chosen += f" The list holds {len(entries):,} of {len(every):,}."
    return Page(
        title=main.name if title is None else title,
        lead=lead_of(runs, documents),
        runs=tuple(run.card for run in (*runs, *twins)),
        sections=sections_of(runs, documents, version=_version(), rng=np.random.default_rng(SEED)),
        episodes=entries,
        packed=packer.packed,
        chosen=chosen,
        extra={"pairs": [pair.to_json() for pair in pairs if packer.has(pair)]},
    )


def _in_order(
    entries: Iterable[dict[str, Any]], main: Shown, order: Sequence[int]
) -> list[dict[str, Any]]:
    """Those of the main run that are on the page as they were chosen, then all others."""
    places = {number: place for place, number in enumerate(order)}

    def key(entry: dict[str, Any]) -> tuple[bool, str, int]:
        is_first = entry["run"] == main.key and entry["packed"]
        number = entry["episode"]
        return (not is_first, entry["run"], places.get(number, 0) if is_first else number)

    return sorted(entries, key=key)


def _list_size(run: Shown) -> int:
    """Of the list of a run's episodes, from that of one of them."""
    few = min(len(run.figures.agents), MOST_AGENTS)
    return len(run.figures.headers) * (ENTRY_BYTES + few * RETURN_BYTES)


def _pairs(runs: Sequence[Shown], twins: Sequence[Shown]) -> list[Pair]:
    main = runs[0]
    found = []
    for other in runs[1:]:
        text = f"{main.name} and {other.name}"
        found += pairs_of(main, other, text=text, most=MOST_PAIRS)
    for twin in twins[1:]:
        found += pairs_of(twins[0], twin, text=twin.name, most=MOST_TWINS)
    return found


def _diverging(documents: Documents, pairs: Sequence[Pair], main: Shown) -> list[int]:
    """Episodes that a diagnosis compared with twins, then those that part from another run's."""
    parted = [
        int(each["episode"])
        for each in (documents.diagnosis or {}).get("partings") or ()
        if each.get("turn") is not None
    ]
    return [*parted, *(pair.left[1] for pair in pairs if pair.left[0] == main.key)]
