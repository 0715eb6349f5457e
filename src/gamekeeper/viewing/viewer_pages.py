"""Pages of the viewer, made of the report's sections: two pages, and single episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from gamekeeper._version import __version__
from gamekeeper.errors import GamekeeperError
from gamekeeper.reporting.page.answers import answers_of, not_asked
from gamekeeper.reporting.page.composition import (
    PLAYER,
    Documents,
    ShownRun,
    alerts_of,
    lead_of,
    sections_of,
)
from gamekeeper.reporting.page.diagnosis_sections import causes_section
from gamekeeper.reporting.page.episode_list import packed_of
from gamekeeper.reporting.page.page_data import Cell, Page, PageBlock, PageSection, PageTable, name
from gamekeeper.reporting.page.page_html import (
    env_words,
    policy_of,
    provenance_section,
    render,
    script,
    style,
)
from gamekeeper.runs.load_run import load
from gamekeeper.viewing.admission import HTML, Response
from gamekeeper.viewing.report_file import documents_of

if TYPE_CHECKING:
    from gamekeeper.viewing.viewer_runs import Edition


SEED: Final = 0
"""Seed of the resamples of intervals."""
FRAMES_BYTES: Final = 16 << 20
"""Size of the frames of one episode; of larger ones every second is sent, and so on."""
TO_WHOLE: Final = (("Whole report: structure, agents, charts", "report"),)
TO_FRONT: Final = (("All episodes", "."),)
COLUMNS: Final = ("run", "folder", "environment", "state")
NO_FRAME: Final = "; frame-ancestors 'none'"
"""A rule that only a header can have, not the page itself."""


def front_page(editions: Sequence[Edition], play_on: Mapping[str, Any] | None = None) -> Response:
    """The page with the player, and sections that need no rows: fast, however long the runs are.

    Args:
        play_on: data with which the page gives orders; None: it gives none.
    """
    runs = [edition.shown for edition in editions]
    documents = _documents(runs[0])
    known = documents.diagnosis, documents.attribution
    named = [(run.key, run.path, run.evidence) for run in runs]
    sections = (
        PageSection(PLAYER, "Episodes"),
        _states(editions),
        *filter(None, (causes_section(*known, key=runs[0].key),)),
        provenance_section(named, version=__version__, audit=documents.audit),
    )
    return _answer(runs, documents, sections, links=TO_WHOLE, play_on=play_on)


def whole_page(editions: Sequence[Edition], play_on: Mapping[str, Any] | None = None) -> Response:
    """The page of a whole report of the runs as they are now."""
    runs = [_apart(edition) for edition in editions]
    documents = _documents(runs[0])
    rng = np.random.default_rng(SEED)
    sections = sections_of(runs, documents, version=__version__, rng=rng)
    return _answer(runs, documents, sections, links=TO_FRONT, play_on=play_on)


def episode_of(edition: Edition, number: int) -> dict[str, Any]:
    """One episode as the player reads it."""
    shown = edition.shown
    return packed_of(
        shown.evidence,
        number,
        run=shown.key,
        labels=shown.labels,
        roster=shown.roster,
        frames=edition.pictures.of(number, FRAMES_BYTES),
        pivots=_documents(shown).pivots,
    )


def _answer(
    runs: Sequence[ShownRun],
    documents: Documents,
    sections: tuple[PageSection, ...],
    *,
    links: tuple[tuple[str, str], ...],
    play_on: Mapping[str, Any] | None,
) -> Response:
    main, is_open = runs[0], runs[0].card.status == "open"
    page = Page(
        title=" · ".join(run.name for run in runs),
        lead=_lead(runs),
        # Figures of a run that grows would be wrong soon.
        answers=() if is_open else answers_of(main, documents),
        not_asked=not_asked(
            main, documents, env=env_words(main.evidence) or "ENV", plays_on=play_on is not None
        ),
        alerts=alerts_of(runs, answered=None if is_open else main),
        runs=tuple(run.card for run in runs),
        sections=sections,
        links=links,
        is_view=True,
        extra={"version": ""} if play_on is None else {"version": "", "play_on": play_on},
    )
    policy = policy_of(style(), script(), is_view=True) + NO_FRAME
    return Response(200, HTML, render(page).encode(), {"Content-Security-Policy": policy})


def _states(editions: Sequence[Edition]) -> PageSection:
    """Section of the runs and their states, with errors of reading them again."""
    rows = []
    for edition in editions:
        run = edition.shown
        state = f"{edition.status}. {run.evidence.not_whole or 'Complete.'}"
        rows.append((name(run.key), name(run.path), name(run.card.environment), Cell(state)))
    alerts = [
        f"Run {edition.shown.key} can't be read again: {edition.error['what']} "
        f"({edition.error['where']}). {edition.error['fix']}"
        for edition in editions
        if edition.error is not None
    ]
    table = PageTable("Runs, when this page was loaded", COLUMNS, tuple(rows))
    return PageSection("runs", "Runs", (PageBlock(alerts=tuple(alerts), tables=(table,)),))


def _lead(runs: Sequence[ShownRun]) -> str:
    """The subject of the page; of a run that grows, without figures that would be wrong soon."""
    main = runs[0].card
    if main.status != "open":
        return lead_of(runs)
    return f"{main.environment} ({main.api}), still recording or never finalized."


def _apart(edition: Edition) -> ShownRun:
    """The run with files of its own, so that episodes needn't wait while all rows are read."""
    run = edition.shown
    is_open = edition.status == "open"  # then its rows are in memory, for any number of threads
    return run if is_open else replace(run, evidence=load(run.path, check=False))


def _documents(run: ShownRun) -> Documents:
    """The documents of the run's annotations; empty where they are damaged, as the index shows."""
    try:
        return documents_of(run.path)
    except GamekeeperError:
        return Documents()
