"""The only writer of a run's files."""

from __future__ import annotations

import os
import queue
import threading
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import pyarrow as pa

from gamekeeper.episodes.tables import merge
from gamekeeper.errors import GamekeeperError, RunError
from gamekeeper.runs.files.checksums import FRAMES, commit
from gamekeeper.runs.files.folder import MANIFEST, claim, inside, replace, system_error, write_new
from gamekeeper.runs.files.manifest import FORMAT_VERSION, STATUSES, render
from gamekeeper.runs.files.open_streams import StreamFiles
from gamekeeper.runs.files.parquet_tables import TableWriter, write_table
from gamekeeper.runs.files.schema import (
    STREAMS,
    check_schema,
    key_arrays,
    plain_batch,
    plain_schema,
    unify,
)
from gamekeeper.runs.files.segments import SegmentReader, SegmentWriter, segment_name

# -- Rolls finished segments into Parquet off the writer's thread, so that closing a run is quick
#
# Segments stay where they are until the run is finalized: what is rolled is a draft
# (`*.parquet.tmp`) that any failure may throw away.

RESTARTS: Final = 3  # drafts thrown away for a wider schema before the rest waits for the close


class Draft:
    """The Parquet file of one stream as far as its segments have been rolled."""

    def __init__(self, path: Path, stream: str) -> None:
        self._path, self._stream = path, stream
        self._segments: list[Path] = []
        self._rolled = self._restarts = 0  # how many segments are in the draft; drafts thrown away
        self._schema: pa.Schema | None = None
        self._writer: TableWriter | None = None

    def add(self, segment: Path, schema: pa.Schema) -> None:
        """Takes the next segment of the stream; its schema may widen the draft's."""
        self._segments.append(segment)
        plain = plain_schema(schema)
        known = self._schema
        self._schema = plain if known is None else unify(known, plain, where=self._stream)
        if self._writer is not None and not self._schema.equals(self._writer.schema):
            self.discard()
            self._restarts += 1

    def roll(self, *, is_last: bool = False) -> None:
        """Puts every segment into the draft that isn't in it yet.

        Raises:
            RunError: a segment can't be read back, or the disk refuses.
        """
        if self._schema is None or (self._restarts > RESTARTS and not is_last):
            return
        if self._writer is None:
            self._writer = TableWriter(self._path, self._schema)
        for segment in self._segments[self._rolled :]:
            reader = SegmentReader(segment, self._stream)
            for batch in reader:
                self._writer.add(batch)
            if not reader.ended:
                raise RunError(
                    f"{segment.name} became shorter while it was being recorded",
                    where=str(segment),
                    fix="leave the run's files alone; `gamekeeper recover` keeps what is whole",
                )
            self._rolled += 1

    def finish(self) -> tuple[Path, int, str] | None:
        """The finished file, its size and digest; None for a stream that never had a batch."""
        self.roll(is_last=True)
        return None if self._writer is None else (self._path, *self._writer.finish())

    def discard(self) -> None:
        """Removes the draft; the segments stay."""
        self._rolled = 0
        if self._writer is not None:
            self._writer.discard()
            self._writer = None


class Roller:
    """A thread that rolls the segments it gets, started when there is something to roll."""

    def __init__(self, folder: Path, streams: tuple[str, ...]) -> None:
        self.drafts = {name: Draft(folder / f"{name}.parquet.tmp", name) for name in streams}
        self._queue: queue.SimpleQueue[tuple[str, Path, pa.Schema] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._failure: GamekeeperError | None = None
        self._is_discarded = False

    def put(self, stream: str, segment: Path, schema: pa.Schema) -> None:
        """Hands over a finished segment."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="gamekeeper-roller", daemon=True)
            self._thread.start()
        self._queue.put((stream, segment, schema))

    def check(self) -> None:
        """Raises the failure of the thread, if there was one.

        Raises:
            RunError: rolling failed.
        """
        if self._failure is not None:
            raise self._failure

    def finish(self) -> dict[str, tuple[Path, int, str]]:
        """Every stream's finished file with its size and digest, once the thread has stopped.

        Segments that were added to a draft since are rolled here: a thread can't be started any
        more when the interpreter is about to end.

        Raises:
            RunError: rolling failed.
        """
        self.check()
        finished = {name: draft.finish() for name, draft in self.drafts.items()}
        return {name: file for name, file in finished.items() if file is not None}

    def discard(self) -> None:
        """Ends the thread and removes the drafts."""
        self._is_discarded = True
        self.stop()
        for draft in self.drafts.values():
            draft.discard()

    def stop(self) -> None:
        """Lets the thread roll what it got, and end."""
        if self._thread is not None:
            self._queue.put(None)
            self._thread.join()
            self._thread = None

    def _run(self) -> None:
        while (item := self._queue.get()) is not None:
            if self._failure is not None or self._is_discarded:
                continue
            stream, segment, schema = item
            try:
                self.drafts[stream].add(segment, schema)
                self.drafts[stream].roll()
            except GamekeeperError as error:
                self._failure = error
            except Exception as error:  # the recorder's thread raises it again with its cause
                self._failure = RunError(
                    f"rolling {segment.name} failed",
                    where=str(segment),
                    actual=repr(error),
                    fix="`gamekeeper recover` finalizes the run from its segments",
                )
                self._failure.__cause__ = error


# -- The only writer of a run's files
#
# The order of writing is what makes a run readable whenever its process dies: batches go
# straight to the operating system; drafts of the Parquet files get their names only when they are
# whole; the manifest follows, finalizing them; then the segments go.

SEGMENT_BYTES: Final = 64 << 20
# Times as much before compression: images shrink so far that only closing would roll them.
RAW: Final = 2
ROLLED: Final = ("agent_steps", "states", "timings")  # episodes are merged first, so they wait


class RunStore:
    """Writes one run: `create`, `append` as often as wanted, then `finalize` or `abandon`.

    For one thread: it keeps a second one for rolling, which only ever reads finished segments.
    """

    STEP: ClassVar[int] = 1
    """From a segment's number to the next one's."""

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
    ) -> Self:
        """Makes the folder (with its parents) and its manifest, with status "open".

        Args:
            path: a folder that doesn't exist yet, or is empty.
            manifest: plain JSON; `format_version` and `status` are set here.
            segment_bytes: a segment that has grown to this is finished and rolled.
            durable: finalized, it survives a power cut; False where it is played again then.
        Raises:
            RunError: something lies there already, or the disk refuses.
            EvidenceError: the manifest isn't plain JSON.
        """
        data = render({**manifest, "format_version": FORMAT_VERSION, "status": "open"})
        folder = Path(path)
        return cls(folder, claim(folder, data, durable=durable), segment_bytes, durable=durable)

    def describe(self, manifest: dict[str, Any]) -> None:
        """Replaces the manifest of the open run.

        Raises:
            RunError: the disk refuses.
            EvidenceError: the manifest isn't plain JSON.
        """
        data = render({**manifest, "format_version": FORMAT_VERSION, "status": "open"})
        replace(self.path / MANIFEST, data, durable=self._durable)

    def append(self, stream: str, batch: pa.RecordBatch) -> None:
        """Hands a batch to the operating system: killing this process doesn't lose it.

        Args:
            stream: "episodes", "agent_steps", "states" or "timings".
            batch: sorted by its first columns `episode` and (but for episodes) `turn`, int32; all
                rows of a turn of an episode are in one batch.
        Raises:
            RunError: the disk refuses, rolling failed, or the batch breaks the above.
        """
        self._check_open()
        self._roller.check()
        if stream not in STREAMS:
            raise RunError(
                "no such stream",
                where=str(self.path),
                expected=", ".join(STREAMS),
                actual=stream,
                fix="append to one of the streams of a run",
            )
        if not batch.num_rows:
            return
        schema = self._checked(stream, batch.schema)
        last = self._check_keys(stream, batch)
        writer = self._writer(stream, schema)
        plain = plain_batch(batch, writer.schema)
        writer.write(plain)
        self._count(stream, plain)
        self._last[stream] = last
        self._raw[stream] = self._raw.get(stream, 0) + batch.nbytes
        if writer.size >= self._segment_bytes or self._raw[stream] >= RAW * self._segment_bytes:
            self._raw[stream] = 0
            self._roll(stream)

    def _count(self, stream: str, batch: pa.RecordBatch) -> None:
        """Takes note of a batch that was written."""

    def write_frame(self, name: str, data: bytes) -> None:
        """Puts a file into `frames/`.

        Raises:
            RunError: the name would leave the folder or is taken, or the disk refuses.
        """
        self._check_open()
        path = inside(self.path, f"{FRAMES}/{name}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_new(path, data)
        except FileExistsError as error:
            raise RunError(
                f"frame {name!r} exists already", where=str(path), fix="name each frame once"
            ) from error
        except OSError as error:
            raise system_error(f"writing frame {name!r}", path, error) from error

    def finalize(self, manifest: dict[str, Any]) -> None:
        """Writes the Parquet files, then the manifest that finalizes them; removes the segments.

        Args:
            manifest: plain JSON; its `status` is "finalized" (the default), "recovered" or
                "failed".
        Raises:
            RunError: the disk refuses; the run stays open, readable and recoverable.
            EvidenceError: the manifest isn't plain JSON.
        """
        self._check_open()
        manifest = {"status": "finalized", **manifest, "format_version": FORMAT_VERSION}
        if manifest["status"] not in STATUSES[1:]:
            raise RunError(
                "a finalized run can't have this status",
                where=str(self.path),
                expected=", ".join(STATUSES[1:]),
                actual=repr(manifest["status"]),
                fix="finalize it with one of these",
            )
        render(manifest)  # an EvidenceError comes before any file is touched
        try:
            self._finalize(manifest)
        except BaseException as error:  # also Ctrl-C: no draft stays behind
            self.abandon()
            if not isinstance(error, OSError) or isinstance(error, RunError):
                raise
            raise system_error("finalizing", self.path, error) from error
        self._close()

    def abandon(self) -> None:
        """Closes the files and leaves them as they are: open, readable, recoverable."""
        if self._is_open:
            self._roller.discard()
            for stream in STREAMS:
                (self.path / f"{stream}.parquet.tmp").unlink(missing_ok=True)
            self._close()

    def _finalize(self, manifest: dict[str, Any]) -> None:
        self._roller.stop()
        for stream, writer in self._writers.items():
            writer.finish()
            if stream in ROLLED:
                self._roller.drafts[stream].add(writer.path, writer.schema)
        files = self._roller.finish()
        table = StreamFiles(self.path, "episodes", salvage=False).table()
        if table is not None:
            files["episodes"] = write_table(
                self.path, "episodes", table.schema, merge(table).to_batches()
            )
        commit(self.path, manifest, files, durable=self._durable)

    def _checked(self, stream: str, schema: pa.Schema) -> pa.Schema:
        """The plain form of a schema; its columns are checked unless the last batch had it."""
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
            raise RunError(
                "a batch breaks the order of turns",
                where=where,
                expected=f"rows sorted by episode and turn, after {before}",
                actual=f"a batch that begins with {first}" if splits else "rows out of order",
                fix="append the rows of a turn in one batch, turns and episodes in their order",
            )
        return int(episode[-1]), int(turn[-1])

    def _writer(self, stream: str, schema: pa.Schema) -> SegmentWriter:
        """The open segment if it has these columns, else a new one that has them and all before."""
        writer = self._writers.get(stream)
        known = self._schemas.get(stream, schema)
        if not schema.equals(known, check_metadata=True):
            known = unify(known, schema, where=f"{self.path}, {stream}")
        if writer is not None:
            if known.equals(writer.schema, check_metadata=True):
                return writer
            self._roll(stream)
        self._schemas[stream] = known
        writer = SegmentWriter(self.path / segment_name(stream, self._counts[stream]), known)
        self._counts[stream] += self.STEP
        self._writers[stream] = writer
        return writer

    def _roll(self, stream: str) -> None:
        """Finishes the open segment and hands it to the roller."""
        writer = self._writers.pop(stream)
        writer.finish()
        if stream in ROLLED:
            self._roller.put(stream, writer.path, writer.schema)

    def _check_open(self) -> None:
        if not self._is_open:
            raise RunError(
                "the run is closed", where=str(self.path), fix="record into another folder"
            )

    def _close(self) -> None:
        for writer in self._writers.values():
            writer.close()
        self._writers.clear()
        self._is_open = False
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1
