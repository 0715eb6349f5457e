"""What is served of the runs, made by the report's page: two pages, and single episodes."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from gamekeeper.adapters.page import documents_of
from gamekeeper.adapters.view.answers import HTML, Answer
from gamekeeper.errors import GamekeeperError
from gamekeeper.record.bundle import load
from gamekeeper.report.page.assets import script, style
from gamekeeper.report.page.causes import causes_section
from gamekeeper.report.page.compose import PLAYER, Documents, Shown, lead_of, sections_of
from gamekeeper.report.page.data import Block, Cell, Page, Section, Table, name
from gamekeeper.report.page.entries import packed_of
from gamekeeper.report.page.provenance import provenance_section
from gamekeeper.report.page.render import policy_of, render

if TYPE_CHECKING:
    from gamekeeper.adapters.view.book import Edition

SEED: Final = 0
"""Of the resamples of intervals."""
FRAMES_BYTES: Final = 16 << 20
"""Of the recorded pictures of one episode; of more every second one is sent, and so on."""
TO_WHOLE: Final = (("Whole report: game form, agents, charts", "report"),)
TO_FRONT: Final = (("All episodes", "."),)
COLUMNS: Final = ("run", "folder", "environment", "state")
STATES: Final = {
    "open": "being recorded, or its recorder was killed",
    "sealed": "whole",
    "recovered": "it was killed; its whole turns are kept",
    "failed": "it broke off",
}
NO_FRAME: Final = "; frame-ancestors 'none'"
"""What a page can't say of itself."""


def front_page(editions: Sequence[Edition]) -> Answer:
    """The player and what costs no look at all rows: there at once, however long the runs are."""
    runs = [edition.shown for edition in editions]
    documents = _documents(runs[0])
    known = documents.diagnosis, documents.attribution
    named = [(run.key, run.path, run.evidence) for run in runs]
    sections = (
        Section(PLAYER, "Episodes"),
        _states(editions),
        *((causes_section(*known, key=runs[0].key),) if known != (None, None) else ()),
        provenance_section(named, version=_version(), audit=documents.audit),
    )
    return _answer(runs, documents, sections, links=TO_WHOLE)


def whole_page(editions: Sequence[Edition]) -> Answer:
    """All that a report says of the runs as they are now, beside the player."""
    runs = [_apart(edition) for edition in editions]
    documents = _documents(runs[0])
    rng = np.random.default_rng(SEED)
    sections = sections_of(runs, documents, version=_version(), rng=rng)
    return _answer(runs, documents, sections, links=TO_FRONT)


def episode_of(edition: Edition, number: int) -> dict[str, Any]:
    """One episode as the player reads it."""
    shown = edition.shown
    return packed_of(
        shown.evidence, number, run=shown.key, labels=shown.labels, seats=shown.seats,
        frames=edition.pictures.of(number, FRAMES_BYTES),
    )  # fmt: skip


def _answer(
    runs: Sequence[Shown],
    documents: Documents,
    sections: tuple[Section, ...],
    *,
    links: tuple[tuple[str, str], ...],
) -> Answer:
    page = Page(
        title=" · ".join(run.name for run in runs),
        lead=_lead(runs, documents),
        runs=tuple(run.card for run in runs),
        sections=sections,
        links=links,
        is_view=True,
        extra={"version": ""},
    )
    policy = policy_of(style(), script(), is_view=True) + NO_FRAME
    return Answer(200, HTML, render(page).encode(), {"Content-Security-Policy": policy})


def _states(editions: Sequence[Edition]) -> Section:
    """Which runs these are, in what state, and why one of them couldn't be read again."""
    rows = []
    for edition in editions:
        run = edition.shown
        state = f"{edition.status}: {STATES[edition.status]}"
        rows.append((name(run.key), name(run.path), name(run.card.environment), Cell(state)))
    alerts = [
        f"Run {edition.shown.key} can't be read again: {edition.error['what']} "
        f"({edition.error['where']}). {edition.error['mend']}"
        for edition in editions
        if edition.error is not None
    ]
    table = Table("Runs, when this page was loaded", COLUMNS, tuple(rows))
    return Section("runs", "Runs", (Block(alerts=tuple(alerts), tables=(table,)),))


def _lead(runs: Sequence[Shown], documents: Documents) -> str:
    """Of a run that grows, nothing that will be wrong a moment later: its list counts."""
    main = runs[0].card
    if main.status != "open":
        return lead_of(runs, documents)
    return f"{main.environment} ({main.api}), being recorded or never sealed."


def _apart(edition: Edition) -> Shown:
    """The run with files of its own: nobody's episode waits while all rows are looked at."""
    run = edition.shown
    is_open = edition.status == "open"  # then its rows are in memory, for any number of threads
    return run if is_open else replace(run, evidence=load(run.path, check=False))


def _version() -> str:
    return str(sys.modules["gamekeeper"].__version__)  # the front stands above all layers


def _documents(run: Shown) -> Documents:
    """What the run's annotations hold; nothing where they are damaged, which the index tells."""
    try:
        return documents_of(run.path)
    except GamekeeperError:
        return Documents()
