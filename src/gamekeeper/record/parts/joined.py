"""The bundle that parts are merged into, while it is written."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from gamekeeper.core.evidence import IDENTITY, fingerprints
from gamekeeper.core.merge import merged_episodes
from gamekeeper.core.press import EPISODES
from gamekeeper.errors import BundleError
from gamekeeper.record.files.claim import claim
from gamekeeper.record.files.folder import inside
from gamekeeper.record.files.manifest import FORMAT_VERSION, load_manifest, render
from gamekeeper.record.files.notes import add_note, read_notes
from gamekeeper.record.files.schema import STREAMS
from gamekeeper.record.files.seal import check_seal, commit, frame_names
from gamekeeper.record.files.table_reader import TableReader
from gamekeeper.record.files.table_writer import TableWriter, write_table
from gamekeeper.record.parts.columns import Columns
from gamekeeper.record.parts.receipt import Receipt

STREAMED: Final = tuple(stream for stream in STREAMS if stream != "episodes")
SAME: Final = (*IDENTITY, "source_digest")
"""What of the environment's identity has to be the same in all parts."""


class Joined:
    """A bundle that takes parts in the order of their episodes, then is sealed or discarded."""

    def __init__(self, folder: Path, parts: list[Receipt]) -> None:
        """Makes the folder.

        Args:
            folder: doesn't exist yet, or is empty.
            parts: all that will come; they say which columns there will be.
        Raises:
            BundleError: something lies there, the disk refuses, or columns don't go together.
        """
        self._folder = folder
        self._columns = _columns(parts)
        self._writers: dict[str, TableWriter] = {}
        self._episodes: list[pa.RecordBatch] = []
        self._manifest: dict[str, Any] = {}
        self._failed = any(receipt.has_failed for receipt in parts)
        self._lock = claim(
            folder,
            render({"format_version": FORMAT_VERSION, "status": "open", "fingerprint": None}),
        )

    def add(self, receipt: Receipt, part: Path) -> None:
        """The rows, frames and notes of a part come next.

        Raises:
            BundleError: it is damaged, or of another environment; or the disk refuses.
        """
        manifest = _checked(part, receipt)
        self._take_manifest(manifest, receipt)
        files = manifest["seal"]["files"]
        for stream in STREAMED:
            if f"{stream}.parquet" in files:
                columns, writer = self._columns[stream], self._writer(stream)
                for batch in TableReader(part / f"{stream}.parquet", stream).batches():
                    writer.add(columns.fit(batch))
        if "episodes.parquet" in files:
            table = TableReader(part / "episodes.parquet", "episodes").read()
            self._episodes += table.cast(EPISODES).to_batches()
        for name in frame_names(part):
            target = inside(self._folder, name)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(inside(part, name), target)
        for note in read_notes(part):
            add_note(self._folder, note)

    def seal(self, error: str | None) -> None:
        """All parts are in: the bundle is sealed, as failed where one did or an `error` is given.

        Raises:
            BundleError: the disk refuses.
        """
        episodes = merged_episodes(self._episodes)
        failed = self._failed or error is not None
        manifest = {
            **self._manifest,
            **fingerprints(self._manifest, episodes),
            "status": "failed" if failed else "sealed",
            "format_version": FORMAT_VERSION,
        }
        if error is not None:
            manifest["error"] = error
        files = {}
        for stream, writer in self._writers.items():
            files[stream] = (writer.path, *writer.finish())
        files["episodes"] = write_table(
            self._folder, "episodes", episodes.schema, episodes.to_batches()
        )
        commit(self._folder, manifest, files)
        self._unlock()

    def discard(self) -> None:
        """Nothing of it is left."""
        for writer in self._writers.values():
            writer.discard()
        self._unlock()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _unlock(self) -> None:
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def _writer(self, stream: str) -> TableWriter:
        if stream not in self._writers:
            path = self._folder / f"{stream}.parquet.tmp"
            self._writers[stream] = TableWriter(path, self._columns[stream].schema)
        return self._writers[stream]

    def _take_manifest(self, manifest: Mapping[str, Any], receipt: Receipt) -> None:
        """The manifest of the whole: the first part's, with the agents of all."""
        if not self._manifest:
            ours = ("seal", "format_version", "status")
            self._manifest = {key: value for key, value in manifest.items() if key not in ours}
            self._manifest["spaces"] = dict(manifest["spaces"])
            self._manifest["agents"] = list(manifest["agents"])
            return
        _check_same(self._manifest, manifest, receipt)
        spaces = self._manifest["spaces"]
        for agent in manifest["agents"]:
            if agent not in spaces:
                spaces[agent] = manifest["spaces"][agent]
                self._manifest["agents"].append(agent)
        if self._manifest["state_space"] is None:
            self._manifest["state_space"] = manifest["state_space"]
        if "error" in manifest:
            self._manifest["error"] = manifest["error"]


def _columns(parts: list[Receipt]) -> dict[str, Columns]:
    found = {stream: Columns(stream) for stream in STREAMED}
    for receipt in parts:
        for stream, columns in found.items():
            schema = receipt.schema(stream)
            if schema is not None:
                columns.widen(schema)
    return found


def _checked(part: Path, receipt: Receipt) -> dict[str, Any]:
    """The manifest of a part, every byte of which is as it was sealed.

    Raises:
        BundleError: it isn't.
    """
    manifest = load_manifest(part)
    damage = check_seal(part)
    if damage:
        raise BundleError(
            "a part was changed after it was sealed",
            where=f"{receipt.key}, {damage[0].file}",
            seen=f"{damage[0].what} {damage[0].detail}".strip(),
            mend=f"take {receipt.folder} and its receipt away and repeat the command: only that "
            "part is played again",
        )
    return manifest


def _check_same(whole: Mapping[str, Any], part: Mapping[str, Any], receipt: Receipt) -> None:
    """The part is of the same environment, with the same spaces for the same agents.

    Raises:
        BundleError: it isn't.
    """
    pairs = [
        (f"environment.{name}", whole["environment"].get(name), part["environment"].get(name))
        for name in SAME
    ]
    pairs += [(name, whole[name], part[name]) for name in ("contract", "level", "seed", "terms")]
    pairs += [
        (f"spaces.{agent}", space, part["spaces"][agent])
        for agent, space in whole["spaces"].items()
        if agent in part["spaces"]
    ]
    if None not in (whole["state_space"], part["state_space"]):
        pairs.append(("state_space", whole["state_space"], part["state_space"]))
    for name, expected, seen in pairs:
        if expected != seen:
            raise BundleError(
                "a part isn't of the same environment as those before it",
                where=f"{receipt.key}, {name}",
                expected=str(expected)[:200],
                seen=str(seen)[:200],
                mend="take the parts away and record again, on machines that have the same code; "
                "where spaces are drawn at random, record in one process, without --workers",
            )
