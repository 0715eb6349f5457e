"""A served run: it is read again when its files grow."""

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from gamekeeper.diagnosis.labels import labels
from gamekeeper.episodes.evidence import Evidence
from gamekeeper.errors import GamekeeperError
from gamekeeper.reporting.page.composition import ShownRun, shown
from gamekeeper.reporting.page.episode_list import entries_of
from gamekeeper.runs.files.folder import MANIFEST
from gamekeeper.runs.files.notes import NOTES
from gamekeeper.runs.load_run import load
from gamekeeper.viewing.report_file import Pictures

SOONEST_S: Final = 1.0
"""Least time between two readings of a run that grows, in seconds."""
SHARE: Final = 4.0
"""Pause after a reading, as a multiple of its duration: a recording needs the cores."""
RECORDED: Final = (".arrows", ".msgpack", ".parquet")

Stamp = tuple[tuple[str, int, int, int], ...]
"""By file: name, inode, size and time of its last change."""


@dataclass(frozen=True, slots=True)
class Edition:
    """A run as it was when it was read.

    Attributes:
        shown: the run and its figures.
        entries: by episode, its entry in the index.
        since: by episode, the edition in which its entry last changed.
        number: of this edition; they count up.
        error: error of reading the files again; None if there was none.
        written: time of the last change of the files, in seconds since 1970.
    """

    shown: ShownRun
    pictures: Pictures
    entries: Mapping[int, Mapping[str, Any]]
    since: Mapping[int, int]
    number: int
    error: Mapping[str, str] | None = None
    written: float = 0.0
    lock: threading.RLock = field(default_factory=threading.RLock, compare=False)
    """Held while rows are read: the files of a run are for one thread at a time."""

    @property
    def status(self) -> str:
        """The run's: open, finalized, recovered, failed."""
        return str(self.shown.evidence.manifest.get("status"))


class ServedRun:
    """A run and its newest edition."""

    def __init__(self, key: str, path: Path, *, name: str | None = None) -> None:
        """Reads the run.

        Args:
            name: on the page; None: the folder's.
        Raises:
            RunError: the folder isn't a run, or is damaged.
        """
        self.key, self.path = key, path
        self._name = path.resolve().name if name is None else name
        self._reading = threading.Lock()
        self._stamp, self._noted = _stamp(path)
        start = time.monotonic()
        self._edition = self._read(None)
        self._next = self._pause(start)

    def edition(self) -> Edition:
        """The newest edition; the files are read again if they changed and the pause is over.

        One request reads; others get the earlier edition meanwhile.
        """
        if time.monotonic() >= self._next and self._reading.acquire(blocking=False):
            try:
                self._look()
            finally:
                self._reading.release()
        return self._edition

    def _look(self) -> None:
        """Reads the files that changed."""
        start = time.monotonic()
        try:
            stamp, noted = _stamp(self.path)
            if (stamp, noted) != (self._stamp, self._noted):
                # A run that only got labels isn't read again.
                self._edition = self._read(self._edition, rows=stamp != self._stamp)
                # As before the reading: changes meanwhile are read the next time.
                self._stamp, self._noted = stamp, noted
        except GamekeeperError as error:
            self._edition = _failed(self._edition, error)
            self._stamp, self._noted = stamp, noted
        except Exception as error:  # a fault of ours is shown on the page like any other error
            fault = GamekeeperError(f"a fault of gamekeeper: {error!r}", fix="please report it")
            self._edition = _failed(self._edition, fault)
        finally:
            self._next = self._pause(start)

    def _read(self, before: Edition | None, *, rows: bool = True) -> Edition:
        written = _written(self.path)
        known, error = _labels_of(self.path)
        if rows or before is None:
            run = shown(
                load(self.path), key=self.key, path=str(self.path), name=self._name, labels=known
            )
            pictures = Pictures(self.path)
        else:
            run, pictures = replace(before.shown, labels=known), before.pictures
        entries = _entries(run)
        number = 1 if before is None else before.number + 1
        changed = _changed(before, run.evidence, entries)
        since = {
            episode: number if before is None or episode in changed else before.since[episode]
            for episode in entries
        }
        return Edition(run, pictures, entries, since, number, error, written)

    @staticmethod
    def _pause(start: float) -> float:
        now = time.monotonic()
        return now + max(SOONEST_S, SHARE * (now - start))


def _entries(run: ShownRun) -> dict[int, dict[str, Any]]:
    """By episode, its entry in the index; all of them can be opened."""
    entries = entries_of(
        run.evidence, run=run.key, labels=run.labels, figures=run.figures, failed=run.failed
    )
    return {int(entry["episode"]): {**entry, "packed": True} for entry in entries}


def _changed(
    before: Edition | None, evidence: Evidence, entries: Mapping[int, Mapping[str, Any]]
) -> set[int]:
    """The episodes that changed, also those whose entry in the index is the same."""
    if before is None:
        return set(entries)
    old, new = _fingerprints(before.shown.evidence), _fingerprints(evidence)
    return {
        episode
        for episode, entry in entries.items()
        if before.entries.get(episode) != entry or old.get(episode) != new.get(episode)
    }


def _fingerprints(evidence: Evidence) -> dict[int, str | None]:
    table = evidence.episode_table
    numbers, found = (table[name].to_pylist() for name in ("episode", "fingerprint"))
    return dict(zip(numbers, found, strict=True))


def _failed(before: Edition, error: GamekeeperError) -> Edition:
    """The earlier edition, with the error of reading a newer one."""
    fields = error.to_json()
    if fields == before.error:
        return before
    return replace(before, number=before.number + 1, error=fields)


def _labels_of(run: Path) -> tuple[list[dict[str, Any]], Mapping[str, str] | None]:
    """The labels of a run; an empty list, and the error, where its annotations are damaged."""
    try:
        return [each.to_json() for each in labels(run)], None
    except GamekeeperError as error:
        return [], error.to_json()


def _written(folder: Path) -> float:
    """Time of the last change of a run's rows, in seconds since 1970."""
    return max((changed for *_, changed in _stamp(folder)[0]), default=0) / 1e9


def _stamp(folder: Path) -> tuple[Stamp, Stamp]:
    """Two values that differ once the rows of a run change, or its annotations."""
    found = []
    try:
        for path in folder.iterdir():
            if path.suffix in RECORDED or path.name in (MANIFEST, NOTES):
                facts = path.stat(follow_symlinks=False)
                found.append((path.name, facts.st_ino, facts.st_size, facts.st_mtime_ns))
    except OSError:
        found.append(("", 0, 0, time.time_ns()))  # finalized or moved meanwhile: look again
    noted = tuple(each for each in found if each[0] == NOTES)
    return tuple(sorted(set(found) - set(noted))), noted
