"""The only writer of a bundle's files.

The order of writing is what makes a bundle readable whenever its process dies: batches go straight
to the operating system; drafts of the Parquet files get their names only when they are whole; the
manifest follows, sealing them; then the segments go.
"""

from __future__ import annotations

import os
from os import PathLike
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from gamekeeper.core.merge import merge
from gamekeeper.errors import BundleError
from gamekeeper.record.files.claim import claim
from gamekeeper.record.files.folder import NEW_FLAGS, inside, system_error, write_all
from gamekeeper.record.files.manifest import FORMAT_VERSION, STATUSES, render
from gamekeeper.record.files.notes import add_note, annotate, read_notes
from gamekeeper.record.files.reading import Bundle, read
from gamekeeper.record.files.recovered import seal_recovered
from gamekeeper.record.files.roller import Roller
from gamekeeper.record.files.schema import (
    STREAMS,
    check_schema,
    key_arrays,
    plain_batch,
    plain_schema,
    unify,
)
from gamekeeper.record.files.seal import FRAMES, commit
from gamekeeper.record.files.segment_writer import SegmentWriter
from gamekeeper.record.files.streams import StreamFiles
from gamekeeper.record.files.table_writer import write_table

__all__ = ["FORMAT_VERSION", "Bundle", "Store", "annotate", "read", "read_notes", "seal_recovered"]

SEGMENT_BYTES: Final = 64 << 20
# Times as much before compression: images shrink so far that only closing would roll them.
RAW: Final = 2
ROLLED: Final = ("steps", "states", "timings")  # episodes are merged first, so they wait


class Store:
    """Writes one run's bundle: `create`, `append` as often as wanted, then `seal` or `abandon`.

    For one thread: it keeps a second one for rolling, which only ever reads finished segments.
    """

    def __init__(
        self, folder: Path, lock: int, segment_bytes: int, *, durable: bool = True
    ) -> None:
        """Takes over a folder; use `create`."""
        self.path = folder
        self._lock = lock
        self._segment_bytes, self._durable = segment_bytes, durable
        self._writers: dict[str, SegmentWriter] = {}
        self._counts = dict.fromkeys(STREAMS, 0)
        self._schemas: dict[str, pa.Schema] = {}
        self._seen: dict[str, tuple[pa.Schema, pa.Schema]] = {}  # last checked, with its plain form
        self._raw: dict[str, int] = {}  # bytes before compression in the open segment
        self._last: dict[str, tuple[int, int]] = {}  # episode and turn
        self._roller = Roller(folder, ROLLED)
        self._is_open = True

    @classmethod
    def create(
        cls,
        path: str | PathLike[str],
        manifest: dict[str, Any],
        *,
        segment_bytes: int = SEGMENT_BYTES,
        durable: bool = True,
    ) -> Store:
        """Makes the folder (with its parents) and its manifest, with status "open".

        Args:
            path: a folder that doesn't exist yet, or is empty.
            manifest: plain JSON; `format_version` and `status` are set here.
            segment_bytes: a segment that has grown to this is finished and rolled.
            durable: sealed, it survives a power cut; False where it is played again then.
        Raises:
            BundleError: something lies there already, or the disk refuses.
            EvidenceError: the manifest isn't plain JSON.
        """
        data = render({**manifest, "format_version": FORMAT_VERSION, "status": "open"})
        folder = Path(path)
        lock = claim(folder, data, durable=durable)
        return cls(folder, lock, segment_bytes, durable=durable)

    def append(self, stream: str, batch: pa.RecordBatch) -> None:
        """The batch is with the operating system: killing this process doesn't lose it.

        Args:
            stream: "episodes", "steps", "states" or "timings".
            batch: sorted by its first columns `episode` and (but for episodes) `turn`, int32; all
                rows of a turn of an episode are in one batch.
        Raises:
            BundleError: the disk refuses, rolling failed, or the batch breaks the above.
        """
        self._check_open()
        self._roller.check()
        if stream not in STREAMS:
            raise BundleError(
                "no such stream", where=str(self.path), expected=", ".join(STREAMS), seen=stream
            )
        if not batch.num_rows:
            return
        schema = self._checked(stream, batch.schema)
        last = self._check_keys(stream, batch)
        writer = self._writer(stream, schema)
        writer.write(plain_batch(batch, writer.schema))
        self._last[stream] = last
        self._raw[stream] = self._raw.get(stream, 0) + batch.nbytes
        if writer.size >= self._segment_bytes or self._raw[stream] >= RAW * self._segment_bytes:
            self._raw[stream] = 0
            self._roll(stream)

    def add_note(self, record: dict[str, Any]) -> None:
        """Adds a line to the annotations; see `annotate`."""
        self._check_open()
        add_note(self.path, record)

    def write_frame(self, name: str, data: bytes) -> None:
        """Puts a file into `frames/`.

        Raises:
            BundleError: the name would leave the folder or is taken, or the disk refuses.
        """
        self._check_open()
        path = inside(self.path, f"{FRAMES}/{name}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(path, NEW_FLAGS, 0o666)
            try:
                write_all(descriptor, data)
            finally:
                os.close(descriptor)
        except FileExistsError as error:
            raise BundleError(
                f"frame {name!r} exists already", where=str(path), mend="name each frame once"
            ) from error
        except OSError as error:
            raise system_error(f"writing frame {name!r}", path, error) from error

    def seal(self, manifest: dict[str, Any]) -> None:
        """The bundle is whole: Parquet files, then the manifest that seals them; segments are gone.

        Args:
            manifest: plain JSON; its `status` is "sealed" (the default), "recovered" or "failed".
        Raises:
            BundleError: the disk refuses; the bundle stays open, readable and recoverable.
            EvidenceError: the manifest isn't plain JSON.
        """
        self._check_open()
        manifest = {"status": "sealed", **manifest, "format_version": FORMAT_VERSION}
        if manifest["status"] not in STATUSES[1:]:
            raise BundleError(
                "a sealed bundle can't have this status",
                where=str(self.path),
                expected=", ".join(STATUSES[1:]),
                seen=repr(manifest["status"]),
            )
        render(manifest)  # an EvidenceError comes before any file is touched
        try:
            self._seal(manifest)
        except BaseException as error:  # also Ctrl-C: no draft stays behind
            self.abandon()
            if not isinstance(error, OSError) or isinstance(error, BundleError):
                raise
            raise system_error("sealing", self.path, error) from error
        self._close()

    def abandon(self) -> None:
        """Closes the files and leaves them as they are: open, readable, recoverable."""
        if self._is_open:
            self._roller.discard()
            for stream in STREAMS:
                (self.path / f"{stream}.parquet.tmp").unlink(missing_ok=True)
            self._close()

    def _seal(self, manifest: dict[str, Any]) -> None:
        self._roller.stop()
        for stream, writer in self._writers.items():
            writer.finish()
            if stream in ROLLED:
                self._roller.add(stream, writer.path, writer.schema)
        files = self._roller.finish()
        table = StreamFiles(self.path, "episodes", salvage=False).table()
        if table is not None:
            files["episodes"] = write_table(
                self.path, "episodes", table.schema, merge(table).to_batches()
            )
        commit(self.path, manifest, files, durable=self._durable)

    def _checked(self, stream: str, schema: pa.Schema) -> pa.Schema:
        """The plain form of a schema; looking at every column is for schemas not seen just now."""
        seen = self._seen.get(stream)
        if seen is not None and schema.equals(seen[0], check_metadata=True):
            return seen[1]
        plain = plain_schema(schema)
        check_schema(plain, stream, where=f"{self.path}, {stream}")
        self._seen[stream] = schema, plain
        return plain

    def _check_keys(self, stream: str, batch: pa.RecordBatch) -> tuple[int, int]:
        where = f"{self.path}, {stream}"
        episode, turn = key_arrays(batch, stream, where=where)
        before = self._last.get(stream, (-1, -1))
        first = int(episode[0]), int(turn[0])
        key = episode << 32 | turn
        is_sorted = bool((key[1:] >= key[:-1]).all())
        splits = stream != "episodes" and first[0] == before[0] and first[1] <= before[1]
        if not is_sorted or splits:
            raise BundleError(
                "a batch breaks the order of turns",
                where=where,
                expected=f"rows sorted by episode and turn, after {before}",
                seen=f"a batch that begins with {first}" if splits else "rows out of order",
            )
        return int(episode[-1]), int(turn[-1])

    def _writer(self, stream: str, schema: pa.Schema) -> SegmentWriter:
        """The open segment if it has these columns, else a new one that has them and all before."""
        writer = self._writers.get(stream)
        known = self._schemas.get(stream)
        if known is None:
            known = schema
        elif not schema.equals(known, check_metadata=True):
            known = unify(known, schema, where=f"{self.path}, {stream}")
        if writer is not None:
            if known.equals(writer.schema, check_metadata=True):
                return writer
            self._roll(stream)
        self._schemas[stream] = known
        writer = SegmentWriter(self._segment(stream, self._counts[stream]), known)
        self._counts[stream] += 1
        self._writers[stream] = writer
        return writer

    def _roll(self, stream: str) -> None:
        """The open segment is finished and handed to the roller."""
        writer = self._writers.pop(stream)
        writer.finish()
        if stream in ROLLED:
            self._roller.put(stream, writer.path, writer.schema)

    def _segment(self, stream: str, number: int) -> Path:
        return self.path / f"{stream}-{number:04d}.arrows"

    def _check_open(self) -> None:
        if not self._is_open:
            raise BundleError(
                "the bundle is closed", where=str(self.path), mend="record into another folder"
            )

    def _close(self) -> None:
        for writer in self._writers.values():
            writer.close()
        self._writers.clear()
        self._is_open = False
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1
