"""The report: runs, and documents about them, as one page in one file.

Counterfactuals that a diagnosis recorded beside a run are added. An existing file is overwritten
only if it is a page too.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np

from gamekeeper._version import __version__
from gamekeeper.auditing.recorded_evidence import failed_rows
from gamekeeper.diagnosis.labels import labels
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.episodes.outcome import TEAM
from gamekeeper.episodes.plain_json import legible
from gamekeeper.errors import EvidenceError, GamekeeperError, RunError
from gamekeeper.reporting.audit_text import broken_rule
from gamekeeper.reporting.page.answers import answers_of, not_asked
from gamekeeper.reporting.page.composition import (
    Documents,
    Pair,
    ShownRun,
    alerts_of,
    lead_of,
    pairs_of,
    sections_of,
    shown,
)
from gamekeeper.reporting.page.episode_list import (
    BUDGET_BYTES,
    MOST_AGENTS,
    Budget,
    chosen_text,
    listed,
    order_of,
)
from gamekeeper.reporting.page.page_data import Page
from gamekeeper.reporting.page.page_html import env_words, render
from gamekeeper.runs.expanding import whole_evidence
from gamekeeper.runs.files.folder import replace, system_error
from gamekeeper.runs.load_run import load
from gamekeeper.viewing.report_documents import Given, PathText, documents_of
from gamekeeper.viewing.report_packer import LETTERS, Packer, Pictures


def opened(
    path: str | PathLike[str],
    *,
    key: str,
    name: str | None = None,
    condition: str | None = None,
    load: Callable[[Path], Evidence] = load,
) -> ShownRun:
    """Opens a run with its figures and labels.

    Args:
        path: the folder of the run.
        name: its name on the page; None: the folder's name.
        condition: under which an episode of the team failed, in place of the contract's.
        load: reads the evidence of a folder.
    """
    folder = Path(path)
    return shown(
        load(folder),
        key=key,
        path=str(path),
        name=folder.resolve().name if name is None else name,
        labels=[each.to_json() for each in labels(folder)],
        condition=condition,
    )


UNCHANGED: Final = "unchanged"


def counterfactuals_of(
    run: Path, main: ShownRun, diagnosis: Mapping[str, Any] | None
) -> Iterator[ShownRun]:
    """The runs that a diagnosis recorded: unchanged, then with each intervention; maybe none.

    Args:
        run: the folder of the run.
        diagnosis: its document, which names the runs.
    """
    recorded = (diagnosis or {}).get("runs")
    if not isinstance(recorded, Mapping) or UNCHANGED not in recorded:
        return
    found = []
    arms = sorted(recorded, key=lambda arm: (arm != UNCHANGED, arm))  # annotations have no order
    for number, arm in enumerate(arms):
        folder = _beside(run, Path(str(recorded[arm])))
        if folder is None:
            continue
        word = "unchanged" if arm == UNCHANGED else f"counterfactual{number}"
        name = f"{main.name}, new seeds, unchanged" if arm == UNCHANGED else f"with {arm}"
        try:
            found.append(opened(folder, key=f"{main.key}.{word}", name=name))
        except GamekeeperError:  # a page without these extras is still right
            return
    if len(found) > 1 and found[0].key.endswith("unchanged"):
        yield from found


def _beside(run: Path, named: Path) -> Path | None:
    """The folder of a diagnosis' run beside the run, also after both were moved.

    No other folder of this machine is read, whatever evidence names.
    """
    beside = run.resolve().parent
    for folder in (beside / f"{run.resolve().name}-diagnosis" / "runs" / named.name, named):
        if folder.is_dir() and beside in folder.resolve().parents:
            return folder
    return None


DOCTYPE: Final = b"<!doctype html>"


def put(target: Path, page: bytes) -> None:
    """Writes the page, in place of an earlier one; also to a device or a pipe.

    Raises:
        RunError: another file has that name, or the disk refuses.
    """
    if target.exists() and not target.is_file():  # a device or a pipe can't be replaced
        try:
            target.write_bytes(page)
        except OSError as error:
            raise system_error(f"writing {target.name}", target, error) from error
        return
    if not _is_free(target):
        raise RunError(
            "another file has the name of the report",
            where=str(target),
            expected="a new name, or that of an earlier report",
            actual="a file that isn't an HTML page",
            fix="name another one with --out, or move it away first",
        )
    replace(target.resolve(), page, durable=False)


def _is_free(target: Path) -> bool:
    try:
        with target.open("rb") as file:
            begun = file.read(len(DOCTYPE))
    except OSError:  # missing, or unreadable: then replacing it says why
        return True
    return begun.lower() in (DOCTYPE, b"")


__all__ = ["Pictures", "documents_of", "opened", "report"]

FRAMES_BYTES: Final = 8_000_000
"""Size of recorded frames on a page, beside its data."""
MOST_PAIRS: Final = 12
"""Most episodes of two runs that are compared."""
MOST_COUNTERFACTUALS: Final = 3
"""Most counterfactuals of each intervention."""
LIST_BYTES: Final = 300_000
"""Size of the list of all episodes."""
ENTRY_BYTES: Final = 260
RETURN_BYTES: Final = 24
"""Approximate size of an episode in that list, and of an agent's return in it."""
SEED: Final = 0
"""Seed of the resamples behind intervals: the same evidence gives the same page."""


def report(
    run: PathText,
    out: PathText = "report.html",
    *,
    others: Iterable[PathText] = (),
    audit: Given = None,
    diagnosis: Given = None,
    attribution: Given = None,
    pivots: Given = None,
    evaluation: Given = None,
    episodes: Iterable[int] = (),
    budget_bytes: int = BUDGET_BYTES,
    frames_bytes: int = FRAMES_BYTES,
    title: str | None = None,
    expand: bool = False,
    allow_import: bool = False,
) -> Path:
    """Writes one self-contained HTML page about a run.

    A diagnosis and an attribution are found in the run's annotations, where their commands store
    them. For a missing document, the page names the command that makes it.

    Args:
        run: the folder of the run that the page is about.
        out: the file to write; a failure leaves no partial file.
        others: runs to compare it with.
        audit: document of `gamekeeper audit --json`, or its file.
        diagnosis: document or file, in place of the run's last diagnosis.
        attribution: document or file, in place of the run's last attribution.
        pivots: document or file of `gamekeeper pivots`, shown on the episodes' timelines.
        evaluation: `evaluation.json` of `gamekeeper evaluate`, or its folder.
        episodes: numbers of episodes that must be on the page.
        budget_bytes: size of all episodes on the page; the others are only listed.
        frames_bytes: size of recorded frames.
        title: of the page; None: the name of the run.
        expand: runs of level `actions` are played again, and shown in full.
        allow_import: code that only such a run names may be imported for it.
    Returns:
        The file.
    Raises:
        RunError: a run is missing or damaged, or the file can't be written.
        EvidenceError: a document has another kind, or a named episode isn't in the run.
        DivergenceError: a run that was to be expanded is played otherwise than recorded.
    """
    paths = [Path(run), *map(Path, others)]
    if len(paths) > len(LETTERS):
        raise EvidenceError(
            "too many runs for one page",
            where="others",
            expected=f"at most {len(LETTERS)}",
            actual=str(len(paths)),
            fix="write several reports",
        )
    documents = documents_of(
        paths[0],
        audit=audit,
        diagnosis=diagnosis,
        attribution=attribution,
        pivots=pivots,
        evaluation=evaluation,
    )
    told = documents.diagnosis or documents.pivots or {}
    condition = told.get("conditions", {}).get(TEAM)
    named = zip(LETTERS, paths, strict=False)
    reader = partial(whole_evidence, allow_import=allow_import) if expand else load
    runs = [opened(path, key=key, condition=condition, load=reader) for key, path in named]
    page = _page(
        runs,
        documents,
        title=title,
        named=tuple(episodes),
        budget=Budget(budget_bytes),
        frames=Budget(frames_bytes),
        counterfactuals=tuple(counterfactuals_of(paths[0], runs[0], documents.diagnosis)),
    )
    target = Path(out)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise system_error("making the folder", target.parent, error) from error
    put(target, render(page).encode())
    return target


@legible
def _page(
    runs: Sequence[ShownRun],
    documents: Documents,
    *,
    title: str | None,
    named: tuple[int, ...],
    budget: Budget,
    frames: Budget,
    counterfactuals: Sequence[ShownRun],
) -> Page:
    main = runs[0]
    pairs = _pairs(runs, counterfactuals)
    order = order_of(
        main.figures,
        failing=main.failed,
        named=named,
        labelled=[each["episode"] for each in main.labels if each["episode"] is not None],
        diverging=_diverging(documents, pairs, main),
    )
    budget.left -= min(_list_size(main), LIST_BYTES)  # the list of all episodes is data too
    packer = Packer([*runs, *counterfactuals], pairs, budget, frames, documents)
    taken = packer.fill(main, order)
    every = [entry for run in (*runs, *counterfactuals) for entry in packer.entries(run)]
    entries = listed(_in_order(every, main, [number for number, _ in order]), most_bytes=LIST_BYTES)
    chosen = chosen_text(taken, len(main.figures.headers), run=main.path)
    if len(entries) < len(every):
        chosen = f"{chosen} The list holds {len(entries):,} of {len(every):,}.".strip()
    return Page(
        title=main.name if title is None else title,
        lead=lead_of(runs),
        answers=answers_of(main, documents),
        not_asked=not_asked(main, documents, env=env_words(main.evidence) or "ENV"),
        alerts=(*alerts_of(runs, answered=main), *_row_alerts(main, documents.audit)),
        runs=tuple(run.card for run in (*runs, *counterfactuals)),
        sections=sections_of(runs, documents, version=__version__, rng=np.random.default_rng(SEED)),
        episodes=entries,
        packed=packer.packed,
        chosen=chosen,
        extra={"pairs": [pair.to_json() for pair in pairs if packer.has(pair)]},
    )


def _row_alerts(run: ShownRun, audit: Mapping[str, Any] | None) -> Iterator[str]:
    """An alert for each rule that the rows of a run break, and that its audit doesn't name."""
    told = {each["id"] for each in (audit or {}).get("verdicts", ()) if each["outcome"] == "failed"}
    for each in failed_rows(run.evidence):
        if each.id not in told:
            where = f" First failed at {each.findings[0].where}." if each.findings else ""
            yield f"The recorded rows break {each.id}. {broken_rule(each.to_json())}{where}"


def _in_order(
    entries: Iterable[dict[str, Any]], main: ShownRun, order: Sequence[int]
) -> list[dict[str, Any]]:
    """Episodes of the main run that are on the page in the order of choice, then all others."""
    places = {number: place for place, number in enumerate(order)}

    def key(entry: dict[str, Any]) -> tuple[bool, str, int]:
        is_first = entry["run"] == main.key and entry["packed"]
        number = entry["episode"]
        return (not is_first, entry["run"], places.get(number, 0) if is_first else number)

    return sorted(entries, key=key)


def _list_size(run: ShownRun) -> int:
    """Estimated size of the list of a run's episodes, in bytes."""
    few = min(len(run.figures.agents), MOST_AGENTS)
    return len(run.figures.headers) * (ENTRY_BYTES + few * RETURN_BYTES)


def _pairs(runs: Sequence[ShownRun], counterfactuals: Sequence[ShownRun]) -> list[Pair]:
    main = runs[0]
    found = []
    for other in runs[1:]:
        text = f"{main.name} and {other.name}"
        found += pairs_of(main, other, text=text, most=MOST_PAIRS)
    for counterfactual in counterfactuals[1:]:
        found += pairs_of(
            counterfactuals[0], counterfactual, text=counterfactual.name, most=MOST_COUNTERFACTUALS
        )
    return found


def _diverging(documents: Documents, pairs: Sequence[Pair], main: ShownRun) -> list[int]:
    """Episodes with a diagnosis' counterfactuals, then those that diverge from another run's."""
    differing = [
        int(each["episode"])
        for each in (documents.diagnosis or {}).get("counterfactuals") or ()
        if each.get("turn") is not None
    ]
    return [*differing, *(pair.left[1] for pair in pairs if pair.left[0] == main.key)]
