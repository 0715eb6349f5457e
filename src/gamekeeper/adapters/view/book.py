"""One run as it is served: read again when its files grew, and what its episodes came to."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from gamekeeper.adapters.page import Pictures
from gamekeeper.adapters.view.answers import error_fields
from gamekeeper.core.evidence import Evidence
from gamekeeper.diagnose.labels import labels
from gamekeeper.errors import GamekeeperError
from gamekeeper.record.bundle import load
from gamekeeper.record.files.manifest import MANIFEST
from gamekeeper.record.files.notes import NOTES
from gamekeeper.report.page.compose import Shown, shown
from gamekeeper.report.page.entries import entries_of

SOONEST_S: Final = 1.0
"""Between two readings of a run that grows, in seconds."""
SHARE: Final = 4.0
"""A reading that took t seconds is followed by none for this many t: a recording has the cores."""
RECORDED: Final = (".arrows", ".parquet")

PATIENCE_S: Final = 0.1
"""How long somebody who asks waits for a reading to end, in seconds."""

Stamp = tuple[tuple[str, int, int, int], ...]
"""By file: name, inode, size and time of its last change."""


@dataclass(frozen=True, slots=True)
class Edition:
    """A run as it was when it was read.

    Attributes:
        shown: what was read, and its figures.
        pictures: its frames, where some were recorded.
        entries: by episode, its line in the index.
        since: by episode, the edition in which its line last changed.
        number: of this edition; they count up.
        error: why the files couldn't be read again; None where they could.
        written: when the files last changed, in seconds since 1970.
    """

    shown: Shown
    pictures: Pictures
    entries: Mapping[int, Mapping[str, Any]]
    since: Mapping[int, int]
    number: int
    error: Mapping[str, str] | None = None
    written: float = 0.0
    lock: threading.RLock = field(default_factory=threading.RLock, compare=False)
    """Held while rows are read: the files of a bundle are for one thread at a time."""

    @property
    def status(self) -> str:
        """The bundle's: open, sealed, recovered, failed."""
        return str(self.shown.evidence.manifest.get("status"))


class Book:
    """A run and its newest edition."""

    def __init__(self, key: str, path: Path) -> None:
        """Reads the run.

        Args:
            key: what the page calls it.
            path: its folder.
        Raises:
            BundleError: there is no bundle, or it is damaged.
        """
        self.key, self.path = key, path
        self._reading = threading.Lock()
        self._stamp, self._noted = _stamp(path)
        start = time.monotonic()
        self._edition = self._read(None)
        self._next = self._pause(start)

    def edition(self) -> Edition:
        """The newest edition; the files are read again if they changed and it is time to.

        Nobody waits long for a large run: who comes while it is being read gets what was read
        before, and the news the next time.
        """
        if time.monotonic() >= self._next and self._reading.acquire(blocking=False):
            reader = threading.Thread(target=self._look, name="gamekeeper-reader", daemon=True)
            try:
                reader.start()
            except BaseException:
                self._reading.release()
                raise
            reader.join(PATIENCE_S)
        return self._edition

    def _look(self) -> None:
        """Reads what changed; the lock that says so is held, and released at the end."""
        start = time.monotonic()
        try:
            stamp, noted = _stamp(self.path)
            if (stamp, noted) != (self._stamp, self._noted):
                # A run that only got labels isn't read again.
                self._edition = self._read(self._edition, rows=stamp != self._stamp)
                # As before the reading: what was written meanwhile is seen the next time.
                self._stamp, self._noted = stamp, noted
        except GamekeeperError as error:
            self._edition = _failed(self._edition, error)
            self._stamp, self._noted = stamp, noted
        except Exception as error:  # a fault of ours, which the page says as it does any other
            self._edition = _failed(
                self._edition, GamekeeperError(f"a fault of gamekeeper: {error!r}")
            )
        finally:
            self._next = self._pause(start)
            self._reading.release()

    def _read(self, before: Edition | None, *, rows: bool = True) -> Edition:
        written = _written(self.path)
        said, error = _said(self.path)
        if rows or before is None:
            evidence = load(self.path)
            name = self.path.resolve().name
            run = shown(evidence, key=self.key, path=str(self.path), name=name, labels=said)
            pictures = Pictures(self.path)
        else:
            run, pictures = replace(before.shown, labels=said), before.pictures
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


def _entries(run: Shown) -> dict[int, dict[str, Any]]:
    """By episode, its line in the index; all of them can be opened here."""
    lines = entries_of(
        run.evidence, run=run.key, labels=run.labels, figures=run.figures, failed=run.failed
    )
    return {int(line["episode"]): {**line, "packed": True} for line in lines}


def _changed(
    before: Edition | None, evidence: Evidence, entries: Mapping[int, Mapping[str, Any]]
) -> set[int]:
    """The episodes that aren't as they were, also where their line in the index is the same."""
    if before is None:
        return set(entries)
    old, new = _fingerprints(before.shown.evidence), _fingerprints(evidence)
    return {
        episode
        for episode, line in entries.items()
        if before.entries.get(episode) != line or old.get(episode) != new.get(episode)
    }


def _fingerprints(evidence: Evidence) -> dict[int, str | None]:
    table = evidence.episodes
    numbers, found = (table[name].to_pylist() for name in ("episode", "fingerprint"))
    return dict(zip(numbers, found, strict=True))


def _failed(before: Edition, error: GamekeeperError) -> Edition:
    """What was read before stays to be looked at, beside the reason why there is no more."""
    fields = error_fields(error)
    if fields == before.error:
        return before
    return replace(before, number=before.number + 1, error=fields)


def _said(run: Path) -> tuple[list[dict[str, Any]], Mapping[str, str] | None]:
    """The labels of a run; none, and the reason, where its annotations are damaged."""
    try:
        return [each.to_json() for each in labels(run)], None
    except GamekeeperError as error:
        return [], error_fields(error)


def _written(folder: Path) -> float:
    """When the rows of a run last changed, in seconds since 1970."""
    return max((changed for *_, changed in _stamp(folder)[0]), default=0) / 1e9


def _stamp(folder: Path) -> tuple[Stamp, Stamp]:
    """What tells whether the rows of a run changed, and whether its annotations did."""
    found = []
    try:
        for path in folder.iterdir():
            if path.suffix in RECORDED or path.name in (MANIFEST, NOTES):
                facts = path.stat(follow_symlinks=False)
                found.append((path.name, facts.st_ino, facts.st_size, facts.st_mtime_ns))
    except OSError:
        found.append(("", 0, 0, time.time_ns()))  # sealed or moved meanwhile: look again
    noted = tuple(each for each in found if each[0] == NOTES)
    return tuple(sorted(set(found) - set(noted))), noted
