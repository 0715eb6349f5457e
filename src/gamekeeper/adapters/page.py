"""The report: runs and what was found out about them, as one page in one file."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np

from gamekeeper.diagnose.labels import labels as labels_of
from gamekeeper.errors import EvidenceError, GamekeeperError
from gamekeeper.record.bundle import load
from gamekeeper.record.files.folder import read_bounded, replace
from gamekeeper.record.files.notes import read_notes
from gamekeeper.report.page.choose import BUDGET_BYTES, Budget, chosen_text, order_of
from gamekeeper.report.page.compose import (
    Documents,
    Pair,
    Shown,
    lead_of,
    pairs_of,
    sections_of,
    shown,
)
from gamekeeper.report.page.data import Page
from gamekeeper.report.page.drawing import Film
from gamekeeper.report.page.entries import MOST_AGENTS, entries_of, listed, packed_of
from gamekeeper.report.page.pack import Mark, deflated
from gamekeeper.report.page.png import data_url
from gamekeeper.report.page.render import render

PathText = str | PathLike[str]
Given = Mapping[str, Any] | PathText | None

FRAMES_BYTES: Final = 8_000_000
"""Of recorded pictures on a page, beside its data."""
FRAMES_PART: Final = 6
"""An episode gets at most this part of what is left for pictures."""
DOCUMENT_BYTES: Final = 1 << 28
LETTERS: Final = "abcdefghijklmnopqrstuvwxyz"
FRAME: Final = re.compile(r"(\d{6,9})-(\d{6,9})\.(png|txt)")
MOST_PAIRS: Final = 12
"""Episodes of two runs that are compared."""
MOST_TWINS: Final = 3
"""Of each remedy."""
FRAME_BYTES: Final = 1 << 26
"""Of one picture."""
LIST_BYTES: Final = 300_000
"""Of the list of all episodes by numbers."""
ENTRY_BYTES: Final = 220
RETURN_BYTES: Final = 24
"""About what an episode takes in that list, and in it an agent's return."""
SHAM: Final = "sham"
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
    runs = [opened(path, key=LETTERS[k]) for k, path in enumerate(paths[: len(LETTERS)])]
    documents = documents_of(
        paths[0], audit=audit, diagnosis=diagnosis, attribution=attribution, evaluation=evaluation
    )
    page = _page(
        runs, documents, title=title, named=tuple(episodes), budget=Budget(budget_bytes),
        frames=Budget(frames_bytes), twins=tuple(_twins(paths[0], runs[0], documents.diagnosis)),
    )  # fmt: skip
    target = Path(out)
    target.parent.mkdir(parents=True, exist_ok=True)
    replace(target, render(page).encode(), durable=False)
    return target


def opened(path: PathText, *, key: str, name: str | None = None) -> Shown:
    """A run with its figures and labels, ready to be shown.

    Args:
        path: the folder of the run.
        key: its letter on the page.
        name: what the page calls it; None: the folder's name.
    """
    folder = Path(path)
    evidence = load(folder)
    said = [each.to_json() for each in labels_of(folder)]
    called = folder.resolve().name if name is None else name
    return shown(evidence, key=key, path=str(path), name=called, labels=said)


def view_page(runs: Sequence[Shown], documents: Documents) -> str:
    """The page that `gamekeeper view` serves: it asks for the list and for episodes by itself.

    Args:
        runs: at least one; the documents are about the first.
        documents: what is known of it.
    """
    main = runs[0]
    page = Page(
        title=main.name,
        lead=lead_of(runs, documents),
        runs=tuple(run.card for run in runs),
        sections=sections_of(runs, documents, version=_version(), rng=np.random.default_rng(SEED)),
        is_view=True,
        extra={"version": ""},
    )
    return render(page)


def _version() -> str:
    # the front stands above all layers, so nobody imports it
    return str(sys.modules["gamekeeper"].__version__)


# -- documents


def documents_of(
    run: PathText,
    *,
    audit: Given = None,
    diagnosis: Given = None,
    attribution: Given = None,
    evaluation: Given = None,
) -> Documents:
    """What is known of a run: what was given, else what its annotations hold.

    Raises:
        EvidenceError: a document isn't of its kind.
        BundleError: a file can't be read.
    """
    noted: dict[str, Any] = {}
    for note in read_notes(run):
        kind = str(note.get("kind"))
        # a diagnosis stands under its own name since before there were other documents
        document = note.get("document", note.get(kind))
        if isinstance(document, Mapping):
            noted[kind] = document
    return Documents(
        audit=_document(audit or noted.get("audit"), "audit", ("verdicts", "measured")),
        diagnosis=_document(diagnosis or noted.get("diagnosis"), "diagnosis", ("agents",)),
        attribution=_document(
            attribution or noted.get("attribution"), "attribution", ("agents", "team")
        ),
        evaluation=_document(evaluation, "evaluation", ("results",)),
    )


def _document(given: Given, kind: str, needed: Sequence[str]) -> Mapping[str, Any] | None:
    """A document, or the one in a file or folder.

    Raises:
        EvidenceError: it isn't one of this kind.
    """
    if given is None:
        return None
    where = kind
    value: Any = given
    if not isinstance(given, Mapping):
        path = Path(given)
        path = path / f"{kind}.json" if path.is_dir() else path
        where = str(path)
        try:
            value = json.loads(read_bounded(path, DOCUMENT_BYTES))
        except (ValueError, RecursionError) as error:
            value = str(error)
    if not isinstance(value, Mapping) or any(name not in value for name in needed):
        raise EvidenceError(
            f"this is no {kind}",
            where=where,
            expected=f"a JSON object with {', '.join(needed)}",
            seen=", ".join(map(str, value))[:100]
            if isinstance(value, Mapping)
            else str(value)[:80],
            mend=f"give what `gamekeeper {COMMANDS[kind]}` wrote",
        )
    return value


COMMANDS: Final = {
    "audit": "audit ENV --json",
    "diagnosis": "diagnose RUN --json",
    "attribution": "attribute RUN --json",
    "evaluation": "evaluate --out FOLDER",
}


# -- the page


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
    packer = _Packer([*runs, *twins], pairs, budget, frames, documents)
    taken = packer.fill(main, order)
    entries = [entry for run in (*runs, *twins) for entry in packer.entries(run)]
    order_on_page = {number: place for place, (number, _) in enumerate(order)}
    entries.sort(key=lambda each: (each["run"] != main.key or not each["packed"],
                                   each["run"],
                                   order_on_page.get(each["episode"], 0) if each["packed"]
                                   else each["episode"]))  # fmt: skip
    shown_entries = listed(entries, most_bytes=LIST_BYTES)
    cut = len(shown_entries) < len(entries)
    return Page(
        title=main.name if title is None else title,
        lead=lead_of(runs, documents),
        runs=tuple(run.card for run in (*runs, *twins)),
        sections=sections_of(runs, documents, version=_version(), rng=np.random.default_rng(SEED)),
        episodes=shown_entries,
        packed=packer.packed,
        chosen=chosen_text(taken, len(main.figures.headers), run=main.path)
        + (f" The list holds {len(shown_entries):,} of {len(entries):,}." if cut else ""),
        extra={"pairs": [pair.to_json() for pair in pairs if packer.has(pair)]},
    )


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


class _Packer:
    """Packs episodes until the budget is spent; an episode's pair goes with it."""

    def __init__(
        self, runs: Sequence[Shown], pairs: Sequence[Pair], budget: Budget, frames: Budget,
        documents: Documents,
    ) -> None:  # fmt: skip
        self.packed: dict[tuple[str, int], bytes] = {}
        self._runs = {run.key: run for run in runs}
        self._pairs, self._budget, self._frames = pairs, budget, frames
        self._pictures = {run.key: Pictures(Path(run.path)) for run in runs}
        self._why: dict[tuple[str, int], tuple[str, ...]] = {}
        self._partings = (documents.diagnosis or {}).get("partings") or ()
        self._main = runs[0].key

    def has(self, pair: Pair) -> bool:
        return pair.left in self.packed and pair.right in self.packed

    def fill(
        self, main: Shown, order: Sequence[tuple[int, tuple[str, ...]]]
    ) -> list[tuple[int, tuple[str, ...]]]:
        """Packs twins and episodes of the main run; those that were taken."""
        twins = [pair for pair in self._pairs if pair.left[0] != main.key]
        taken = []
        for number, why in order:
            is_named = "named" in why
            if self._budget.is_spent and not is_named:
                break
            if not self._take(main.key, number, why, must=is_named):
                continue
            taken.append((number, why))
            for pair in self._pairs:
                if pair.left == (main.key, number):
                    self._take(*pair.right, ("pair",))
            if twins:  # one pair of twins after each episode, so that neither crowds out the other
                pair = twins.pop(0)
                self._take(*pair.left, ("twin",))
                self._take(*pair.right, ("twin",))
        return taken

    def _take(self, key: str, number: int, why: tuple[str, ...], *, must: bool = False) -> bool:
        if (key, number) in self.packed:
            return True
        run = self._runs[key]
        frames = self._pictures[key].of(number, self._frames.left // FRAMES_PART)
        data = deflated(
            packed_of(
                run.evidence, number, run=key, labels=run.labels, seats=run.seats,
                marks=self._marks(key, number), frames=frames,
                failed=run.failed[run.figures.place(number)],
            )
        )  # fmt: skip
        pictures = 0 if frames is None else sum(map(len, frames.shown.values())) * 3 // 4
        size = max(len(data) - pictures, 0) * 4 // 3
        if not self._budget.take(size) and not must:
            return False
        self._frames.take(pictures)
        self.packed[key, number] = data
        self._why[key, number] = why
        return True

    def _marks(self, key: str, number: int) -> Iterator[Mark]:
        for pair in self._pairs:
            if (key, number) in (pair.left, pair.right) and pair.divergence is not None:
                where = pair.divergence
                yield Mark(where.turn or 0, "divergence", f"{pair.text}: {where.field}",
                           where.agent)  # fmt: skip
                if (key, number) == pair.right and pair.right[0] not in LETTERS:
                    yield Mark(0, "change", self._runs[key].name)
        for each in self._partings if key == self._main else ():
            if each["episode"] == number and each["turn"] is not None:
                text = f"parts from its twin under {each['remedy']}: {each['field']}"
                yield Mark(int(each["turn"]), "divergence", text, each["agent"])

    def entries(self, run: Shown) -> Iterator[dict[str, Any]]:
        """The run's episodes by numbers; of twins only those that are on the page."""
        bases = {pair.right: pair for pair in self._pairs}
        is_twin = run.key not in LETTERS
        for entry in entries_of(
            run.evidence, run=run.key, labels=run.labels, figures=run.figures, failed=run.failed
        ):
            place = (run.key, entry["episode"])
            if is_twin and place not in self.packed:
                continue
            pair = bases.get(place)
            base = None if pair is None else {"run": pair.left[0], "episode": pair.left[1]}
            yield {
                **entry,
                "packed": place in self.packed,
                "why": list(self._why.get(place, ())),
                "base": base,
                "change": run.name if is_twin and base else None,
            }


# -- twins and pictures


def _twins(run: Path, main: Shown, diagnosis: Mapping[str, Any] | None) -> Iterator[Shown]:
    """The bundles that a diagnosis kept: as it is, then under each remedy. None if they're gone."""
    bundles = (diagnosis or {}).get("bundles")
    if not isinstance(bundles, Mapping) or SHAM not in bundles:
        return
    found = []
    for number, (arm, told) in enumerate(bundles.items()):
        folder = _kept(run, str(told))
        if folder is None:
            continue
        word = "sham" if arm == SHAM else f"twin{number}"
        name = f"{main.name}, fresh seeds, as it is" if arm == SHAM else f"with {arm}"
        try:
            found.append(opened(folder, key=f"{main.key}.{word}", name=name))
        except GamekeeperError:  # the twins of a page are an extra: without them it is still true
            return
    if len(found) > 1 and found[0].key.endswith("sham"):
        yield from found


def _kept(run: Path, told: str) -> Path | None:
    """The folder of a kept bundle beside the run, wherever both were moved to.

    Evidence names no other folder of this machine that would be read.
    """
    beside = run.resolve().parent
    name = Path(told).name
    for folder in (beside / f"{run.resolve().name}-diagnosis" / "bundles" / name, Path(told)):
        if folder.is_dir() and beside in folder.resolve().parents:
            return folder
    return None


class Pictures:
    """The recorded frames of a run, thinned out to fit."""

    def __init__(self, run: Path) -> None:
        """Looks which there are."""
        self._files: dict[int, dict[int, Path]] = {}
        folder = run / "frames"
        if folder.is_symlink() or not folder.is_dir():
            return
        for path in sorted(folder.iterdir()):
            found = FRAME.fullmatch(path.name)
            if found is not None and path.is_file() and not path.is_symlink():
                self._files.setdefault(int(found[1]), {})[int(found[2])] = path

    def of(self, episode: int, most_bytes: int) -> Film | None:
        """What was rendered by turn; every k-th picture where they don't all fit."""
        files = self._files.get(episode)
        if not files:
            return None
        size = sum(path.stat().st_size for path in files.values())
        step = max(1, -(-size // max(most_bytes, 1)))
        turns = sorted(files)[::step]
        if len(turns) < 2 <= len(files) and step > 1:
            return None
        is_text = files[turns[0]].suffix == ".txt"
        kept = {turn: read_bounded(files[turn], FRAME_BYTES) for turn in turns}
        return Film(
            {
                turn: data.decode(errors="replace") if is_text else data_url(data)
                for turn, data in kept.items()
                if (files[turn].suffix == ".txt") is is_text
            },
            is_text=is_text,
        )
