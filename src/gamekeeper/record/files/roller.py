"""Rolls finished segments into Parquet off the writer's thread, so that closing a run is quick.

Segments stay where they are until the bundle is sealed: what is rolled is a draft (`*.parquet.tmp`)
that any failure may throw away.
"""

from __future__ import annotations

import queue
import threading
from pathlib import Path
from typing import Final

import pyarrow as pa

from gamekeeper.errors import BundleError, GamekeeperError
from gamekeeper.record.files.schema import plain_schema, unify
from gamekeeper.record.files.segment_reader import SegmentReader
from gamekeeper.record.files.table_writer import TableWriter

RESTARTS: Final = 3  # drafts thrown away for a wider schema before the rest waits for the close


class Draft:
    """The Parquet file of one stream as far as its segments have been rolled."""

    __slots__ = ("_path", "_restarts", "_rolled", "_schema", "_segments", "_stream", "_writer")

    def __init__(self, path: Path, stream: str) -> None:
        self._path, self._stream = path, stream
        self._segments: list[Path] = []
        self._rolled = 0  # how many of them are in the draft
        self._restarts = 0
        self._schema: pa.Schema | None = None
        self._writer: TableWriter | None = None

    def add(self, segment: Path, schema: pa.Schema) -> None:
        """The next segment of the stream; its schema may widen the draft's."""
        self._segments.append(segment)
        known = self._schema
        plain = plain_schema(schema)
        self._schema = plain if known is None else unify(known, plain, where=self._stream)
        if self._writer is not None and not self._schema.equals(self._writer.schema):
            self.discard()
            self._restarts += 1

    def roll(self, *, is_last: bool = False) -> None:
        """Every segment that isn't in the draft yet is.

        Raises:
            BundleError: a segment can't be read back, or the disk refuses.
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
                raise BundleError(
                    f"{segment.name} became shorter while it was being recorded",
                    where=str(segment),
                    mend="leave the bundle's files alone; `gamekeeper recover` keeps what is whole",
                )
            self._rolled += 1

    def finish(self) -> tuple[Path, int, str] | None:
        """The finished file, its size and digest; None for a stream that never had a batch."""
        self.roll(is_last=True)
        if self._writer is None:
            return None
        size, digest = self._writer.finish()
        self._writer = None
        return self._path, size, digest

    def discard(self) -> None:
        """The draft is gone, the segments stay."""
        self._rolled = 0
        if self._writer is not None:
            self._writer.discard()
            self._writer = None


class Roller:
    """A thread that rolls what it is given, started when there is something to roll."""

    def __init__(self, folder: Path, streams: tuple[str, ...]) -> None:
        self._drafts = {name: Draft(folder / f"{name}.parquet.tmp", name) for name in streams}
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
        """Raises what failed since the last call.

        Raises:
            BundleError: rolling failed.
        """
        if self._failure is not None:
            raise self._failure

    def add(self, stream: str, segment: Path, schema: pa.Schema) -> None:
        """Takes a segment that `finish` rolls, once the thread has stopped.

        (A thread can't be started any more when the interpreter is about to end.)
        """
        self._drafts[stream].add(segment, schema)

    def finish(self) -> dict[str, tuple[Path, int, str]]:
        """Every stream's finished file with its size and digest.

        Raises:
            BundleError: rolling failed.
        """
        self.stop()
        self.check()
        finished = {name: draft.finish() for name, draft in self._drafts.items()}
        return {name: file for name, file in finished.items() if file is not None}

    def discard(self) -> None:
        """The thread has ended and the drafts are gone."""
        self._is_discarded = True
        self.stop()
        for draft in self._drafts.values():
            draft.discard()

    def stop(self) -> None:
        """The thread has rolled what it was given, and ended."""
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
                self._drafts[stream].add(segment, schema)
                self._drafts[stream].roll()
            except GamekeeperError as error:
                self._failure = error
            except Exception as error:  # the recorder's thread raises it again with its cause
                self._failure = BundleError(f"rolling {segment.name} failed", seen=repr(error))
                self._failure.__cause__ = error
