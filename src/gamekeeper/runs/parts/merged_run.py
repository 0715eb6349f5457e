"""The run that parts are merged into, while it is written."""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from gamekeeper.episodes.encoder import EPISODES
from gamekeeper.episodes.evidence import IDENTITY, fingerprints
from gamekeeper.episodes.tables import merged_episodes
from gamekeeper.errors import RunError
from gamekeeper.runs import own_runs
from gamekeeper.runs.files.checksums import commit, compare_checksums, frame_names, root_digest
from gamekeeper.runs.files.folder import claim, inside
from gamekeeper.runs.files.manifest import FORMAT_VERSION, load_manifest, render
from gamekeeper.runs.files.notes import add_note, read_notes
from gamekeeper.runs.files.parquet_tables import TableReader, TableWriter, write_episodes
from gamekeeper.runs.files.schema import STREAMS, plain_schema
from gamekeeper.runs.load_run import load
from gamekeeper.runs.parts.receipts import Receipt
from gamekeeper.runs.run_check import with_prints

# -- Columns of parts put together: one that a part names otherwise, or lacks, finds its place
#
# A column's name depends on the other agents of a run, so that of an agent that joined late may be
# another in another part. Its leaf (tag, dtype, shape) is the same: digests and readers go by that.


class PartColumns:
    """The columns of one stream over all parts; they grow, and none changes its type."""

    def __init__(self, stream: str) -> None:
        self._stream = stream
        self._fields: dict[str, pa.Field] = {}

    @property
    def schema(self) -> pa.Schema:
        """All columns there are so far: what parts share first, in their order."""
        return pa.schema(list(self._fields.values()))

    def widen(self, schema: pa.Schema) -> None:
        """Gives the columns of one more part their places.

        Raises:
            RunError: a column without a leaf changes its type.
        """
        plain = plain_schema(schema)
        names = self.names(plain)
        for field in plain:
            name = names[field.name]
            known = self._fields.get(name)
            if known is None:
                self._fields[name] = field.with_name(name)
            elif known.type != field.type:
                raise RunError(
                    "a column has another type in another part",
                    where=f"{self._stream}, {field.name}",
                    expected=str(known.type),
                    actual=str(field.type),
                    fix="record in one process, without --workers",
                )

    def fit(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        """A part's batch with its columns named as they are in the whole."""
        return batch.rename_columns(list(map(self.names(batch.schema).get, batch.schema.names)))

    def names(self, schema: pa.Schema) -> Mapping[str, str]:
        """By a part's name of each of its columns the name in the whole."""
        found: dict[str, str] = {}
        strange: list[pa.Field] = []
        # Columns that are known by their name come first, so that none of the others takes it.
        for field in schema:
            known = self._fields.get(field.name)
            if known is not None and _leaf(known) == _leaf(field):
                found[field.name] = field.name
            else:
                strange.append(field)
        for field in strange:
            found[field.name] = self._place(field, taken=set(found.values()))
        return found

    def _place(self, field: pa.Field, *, taken: set[str]) -> str:
        """Name in the whole of a column that isn't known by its own: its equal's, or a new one."""
        leaf = _leaf(field)
        if leaf is not None:
            for name, known in self._fields.items():
                if name not in taken and _leaf(known) == leaf and known.type == field.type:
                    return name
        name = str(field.name)
        while name in taken or (name in self._fields and leaf is not None):
            name += "'"
        return name


def _leaf(field: pa.Field) -> tuple[bytes, bytes] | None:
    """Tag and leaf of a value column; None for a column that every run has."""
    metadata = field.metadata or {}
    return (metadata[b"tag"], metadata[b"leaf"]) if b"leaf" in metadata else None


# -- The run that parts are merged into, while it is written

STREAMED: Final = tuple(stream for stream in STREAMS if stream != "episodes")
SAME: Final = (*IDENTITY, "source_digest")
"""Fields of the environment's identity that must be the same in all parts."""


class MergedRun:
    """A run that takes parts in the order of their episodes, then is finalized or discarded."""

    def __init__(self, folder: Path, parts: list[Receipt]) -> None:
        """Makes the folder.

        Args:
            folder: doesn't exist yet, or is empty.
            parts: all that will come, with the columns that there will be.
        Raises:
            RunError: something lies there, the disk refuses, or columns don't go together.
        """
        self._folder = folder
        self._columns = {stream: PartColumns(stream) for stream in STREAMED}
        for receipt in parts:
            for stream, columns in self._columns.items():
                schema = receipt.schema(stream)
                if schema is not None:
                    columns.widen(schema)
        self._writers: dict[str, TableWriter] = {}
        self._episodes: list[pa.RecordBatch] = []
        self._manifest: dict[str, Any] = {}
        self._failed = any(receipt.has_failed for receipt in parts)
        self._modules: dict[str, tuple[str, str]] | None = {}
        self._lock = claim(
            folder,
            render({"format_version": FORMAT_VERSION, "status": "open", "fingerprint": None}),
        )

    def add(self, receipt: Receipt, part: Path) -> None:
        """Adds the rows, frames and notes of the next part.

        Raises:
            RunError: it is damaged, or of another environment; or the disk refuses.
        """
        manifest = _checked(part, receipt)
        self._take_manifest(manifest, receipt)
        files = manifest["checksums"]["files"]
        for stream in STREAMED:
            if f"{stream}.parquet" in files:
                columns = self._columns[stream]
                if stream not in self._writers:
                    draft = self._folder / f"{stream}.parquet.tmp"
                    self._writers[stream] = TableWriter(draft, columns.schema)
                for batch in TableReader(part / f"{stream}.parquet", stream).batches():
                    self._writers[stream].add(columns.fit(batch))
        if "episodes.parquet" in files:
            self._episodes += with_prints(load(part, check=False)).cast(EPISODES).to_batches()
        for name in frame_names(part):
            target = inside(self._folder, name)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(inside(part, name), target)
        for note in read_notes(part):
            add_note(self._folder, note)
        self._take_modules(part)

    def finalize(self, error: str | None) -> None:
        """Finalizes the run, once all parts are in; as failed where one did or an `error` is given.

        Raises:
            RunError: the disk refuses.
        """
        episodes = merged_episodes(self._episodes)
        manifest = {
            **self._manifest,
            **fingerprints(self._manifest, episodes),
            "status": "failed" if self._failed or error is not None else "finalized",
            "format_version": FORMAT_VERSION,
            **({} if error is None else {"error": error}),
        }
        files = {name: (each.path, *each.finish()) for name, each in self._writers.items()}
        files["episodes"] = write_episodes(self._folder, episodes, level=manifest.get("level"))
        commit(self._folder, manifest, files)
        if self._modules is not None:
            own_runs.remember(self._folder, self._modules)
        self._unlock()

    def discard(self) -> None:
        """Removes the run."""
        for writer in self._writers.values():
            writer.discard()
        self._unlock()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _take_modules(self, part: Path) -> None:
        """Counts the whole as an own run if all parts are; forgets the parts."""
        root = root_digest(part, check=False)
        modules = own_runs.recall(root)
        own_runs.forget(root)
        if modules is None:
            self._modules = None
        elif self._modules is not None:
            self._modules.update(modules)

    def _unlock(self) -> None:
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def _take_manifest(self, manifest: Mapping[str, Any], receipt: Receipt) -> None:
        """Makes the manifest of the whole: the first part's, with the agents of all."""
        if not self._manifest:
            ours = ("checksums", "format_version", "status")
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
        self._manifest |= {key: manifest[key] for key in ("error", "stopped") if key in manifest}


def _checked(part: Path, receipt: Receipt) -> dict[str, Any]:
    """The manifest of a part, every byte of which is as it was finalized.

    Raises:
        RunError: it isn't.
    """
    manifest = load_manifest(part)
    damage = compare_checksums(part)
    if damage:
        raise RunError(
            "a part was changed after it was finalized",
            where=f"{receipt.key}, {damage[0].file}",
            actual=f"{damage[0].what} {damage[0].detail}".strip(),
            fix=f"take {receipt.folder} and its receipt away and repeat the command: only that "
            "part is played again",
        )
    return manifest


def _check_same(whole: Mapping[str, Any], part: Mapping[str, Any], receipt: Receipt) -> None:
    """Checks that a part is of the same environment, with the same spaces for the same agents.

    Raises:
        RunError: it isn't.
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
            raise RunError(
                "a part isn't of the same environment as those before it",
                where=f"{receipt.key}, {name}",
                expected=str(expected)[:200],
                actual=str(seen)[:200],
                fix="take the parts away and record again, on machines that have the same code; "
                "where spaces are drawn at random, record in one process, without --workers",
            )
