"""The only writer of a run's files."""

import os
import queue
import threading
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import pyarrow as pa

from gamekeeper.episodes.encoder import EPISODES
from gamekeeper.episodes.tables import merge
from gamekeeper.errors import GamekeeperError, RunError
from gamekeeper.runs.files.checksums import FRAMES, commit
from gamekeeper.runs.files.folder import MANIFEST, claim, inside, replace, system_error, write_new
from gamekeeper.runs.files.journal import JournalWriter
from gamekeeper.runs.files.manifest import FORMAT_VERSION, STATUSES, render
from gamekeeper.runs.files.open_streams import StreamFiles
from gamekeeper.runs.files.parquet_tables import (
    GROUP_BYTES,
    GROUP_ROWS,
    TableWriter,
    write_episodes,
)
from gamekeeper.runs.files.schema import (
    STREAMS,
    check_schema,
    key_arrays,
    plain_batch,
    plain_schema,
    unify,
)
from gamekeeper.runs.files.segments import SegmentWriter, segment_name

# -- Parquet files grow off the writer's thread while a run is recorded, so that closing it is quick
#
# Segments stay where they are until the run is finalized: a draft (`*.parquet.tmp`) is what any
# failure may throw away.

MOST_BYTES: Final = 256 << 20  # handed over and not in a draft yet; beyond, appending waits


class Draft:
    """The Parquet file of one stream as far as it goes.

    One that lacks a column which came after a row group was written is made from the segments.
    """

    def __init__(self, path: Path, stream: str) -> None:
        self._path, self._stream = path, stream
        self._writer: TableWriter | None = None
        self._is_stale = False

    def add(self, batch: pa.RecordBatch) -> None:
        """Takes the next batch of the stream; its schema has all columns so far.

        Raises:
            RunError: the disk refuses.
        """
        if self._writer is None:
            self._writer = TableWriter(self._path, batch.schema)
        self._is_stale |= not self._writer.widen(batch.schema)
        if not self._is_stale:
            self._writer.add(batch)

    def finish(self) -> tuple[Path, int, str] | None:
        """The finished file, its size and digest; None for a stream that never had a batch.

        Raises:
            RunError: a segment can't be read back, or the disk refuses.
        """
        writer = self._writer
        if writer is not None and self._is_stale:
            writer.discard()
            writer = self._writer = TableWriter(self._path, writer.schema)
            segments = StreamFiles(self._path.parent, self._stream, salvage=False)
            for batch in segments.batches():
                writer.add(batch)
            for cut in segments.cuts:
                raise RunError(
                    f"{cut.file} became shorter while it was being recorded",
                    where=str(self._path.parent / cut.file),
                    fix="leave the run's files alone; `gamekeeper recover` keeps what is whole",
                )
        return None if writer is None else (self._path, *writer.finish())

    def discard(self) -> None:
        """Removes the draft; the segments stay."""
        if self._writer is not None:
            self._writer.discard()


class Roller:
    """A thread that puts batches into drafts, started when a row group of them is there."""

    def __init__(self, folder: Path, streams: tuple[str, ...]) -> None:
        self._drafts = {name: Draft(folder / f"{name}.parquet.tmp", name) for name in streams}
        self._waiting: dict[str, list[pa.RecordBatch]] = {name: [] for name in streams}
        self._sizes = dict.fromkeys(streams, (0, 0))  # rows and bytes that wait
        self._queue: queue.SimpleQueue[tuple[str, list[pa.RecordBatch]] | None]
        self._queue = queue.SimpleQueue()
        self._behind = 0  # bytes in the queue
        self._turn = threading.Condition()
        self._thread: threading.Thread | None = None
        self._failure: GamekeeperError | None = None
        self._is_discarded = False

    def put(self, stream: str, batch: pa.RecordBatch) -> None:
        """Hands over the next batch of a stream."""
        self._waiting[stream].append(batch)
        rows, size = self._sizes[stream]
        rows, size = rows + batch.num_rows, size + batch.nbytes
        self._sizes[stream] = rows, size
        if rows < GROUP_ROWS and size < GROUP_BYTES:
            return
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="gamekeeper-roller", daemon=True)
            self._thread.start()
        with self._turn:
            self._turn.wait_for(lambda: self._behind <= MOST_BYTES)
            self._behind += size
        self._queue.put((stream, self._waiting[stream]))
        self._waiting[stream], self._sizes[stream] = [], (0, 0)

    def check(self) -> None:
        """Raises the failure of the thread, if there was one.

        Raises:
            RunError: rolling failed.
        """
        if self._failure is not None:
            raise self._failure

    def finish(self) -> dict[str, tuple[Path, int, str]]:
        """Every stream's finished file with its size and digest, once the thread has stopped.

        What still waits is put into drafts here: a thread can't be started any more when the
        interpreter is about to end.

        Raises:
            RunError: rolling failed.
        """
        self.check()
        for stream, batches in self._waiting.items():
            self._add(stream, batches)
        self.check()
        finished = {name: draft.finish() for name, draft in self._drafts.items()}
        return {name: file for name, file in finished.items() if file is not None}

    def discard(self) -> None:
        """Ends the thread and removes the drafts."""
        self._is_discarded = True
        self.stop()
        for draft in self._drafts.values():
            draft.discard()

    def stop(self) -> None:
        """Lets the thread put away what it got, and end."""
        if self._thread is not None:
            self._queue.put(None)
            self._thread.join()
            self._thread = None

    def _run(self) -> None:
        while (item := self._queue.get()) is not None:
            stream, batches = item
            if self._failure is None and not self._is_discarded:
                self._add(stream, batches)
            with self._turn:
                self._behind -= sum(batch.nbytes for batch in batches)
                self._turn.notify()

    def _add(self, stream: str, batches: list[pa.RecordBatch]) -> None:
        try:
            for batch in batches:
                self._drafts[stream].add(batch)
        except GamekeeperError as error:
            self._failure = error
        except Exception as error:  # the recorder's thread raises it again with its cause
            self._failure = RunError(
                f"rolling {stream} into its Parquet file failed",
                where=stream,
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
ROLLED: Final = ("agent_steps", "states", "timings")  # episodes are merged first, so they wait


class RunStore:
    """Writes one run: `create`, `append` as often as wanted, then `finalize` or `abandon`.

    For one thread: it keeps a second one, which writes row groups of the Parquet files.
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
        self._last: dict[str, tuple[int, int]] = {}  # episode and turn
        self._rows: pa.Table | None = None  # of episodes, once nothing more is appended
        self._roller = Roller(folder, ROLLED)
        self.journal = JournalWriter(folder)
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
            segment_bytes: a segment that has grown to this is finished, and another begun.
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
        self._rows = None
        schema = self._checked(stream, batch.schema)
        last = self._check_keys(stream, batch)
        writer = self._writer(stream, schema)
        plain = plain_batch(batch, writer.schema)
        writer.write(plain)
        self._count(stream, plain)
        self._last[stream] = last
        if writer.size >= self._segment_bytes:
            self._end_segment(stream)

    def _count(self, stream: str, batch: pa.RecordBatch) -> None:
        """Takes note of a batch that was written."""
        if stream in ROLLED:
            self._roller.put(stream, batch)

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

    def settle(self) -> tuple[pa.Table, dict[str, Any]]:
        """Ends the segments, once all is appended.

        Returns:
            The rows of the episodes that stay, and entries of the manifest that say which.
        Raises:
            RunError: the disk refuses, or a segment can't be read back.
        """
        for stream in list(self._writers):
            self._end_segment(stream)
        if self._rows is None:
            table = StreamFiles(self.path, "episodes", salvage=False).table()
            self._rows = EPISODES.empty_table() if table is None else merge(table)
        return self._rows, {}

    def _finalize(self, manifest: dict[str, Any]) -> None:
        rows, _ = self.settle()
        self._roller.stop()
        files = self._roller.finish()
        if self._counts["episodes"]:
            files["episodes"] = write_episodes(self.path, rows, level=manifest.get("level"))
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
            self._end_segment(stream)
        self._schemas[stream] = known
        writer = SegmentWriter(self.path / segment_name(stream, self._counts[stream]), known)
        self._counts[stream] += self.STEP
        self._writers[stream] = writer
        return writer

    def _end_segment(self, stream: str) -> None:
        """Finishes the open segment."""
        self._writers.pop(stream).finish()

    def _check_open(self) -> None:
        if not self._is_open:
            raise RunError(
                "the run is closed", where=str(self.path), fix="record into another folder"
            )

    def _close(self) -> None:
        self.journal.close()
        for writer in self._writers.values():
            writer.close()
        self._writers.clear()
        self._is_open = False
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1
