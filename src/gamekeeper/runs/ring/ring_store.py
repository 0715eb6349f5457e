"""Writer of a run that stays within a size: old segments are written anew without what is dropped.

Rows reach the operating system as in every run, in segments of even numbers. Once these take more
than a part of the size, they are finished; the rows after go into others behind them. A thread
writes what stays into segments of the odd number that follows each stream's last one, and replaces
the manifest, which says where each stream begins. Only then the old ones are removed. So the run
can be read and recovered whenever its process is killed, and no row waits meanwhile.
"""

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.episodes.encoder import EPISODES
from gamekeeper.episodes.tables import merged_episodes
from gamekeeper.errors import GamekeeperError, RunError
from gamekeeper.runs.files.checksums import commit
from gamekeeper.runs.files.parquet_tables import write_episodes, write_table
from gamekeeper.runs.files.schema import STREAMS, plain_batch
from gamekeeper.runs.files.segments import SegmentReader, SegmentWriter, segment_name
from gamekeeper.runs.files.store import ROLLED, RunStore
from gamekeeper.runs.ring.ring_ledger import RingLedger

FULL: Final = 1 / 2
"""Part of the size from which segments are written anew."""
CROWDED: Final = 3 / 4
"""Part of the size at which that is waited for."""
BATCH_ROWS: Final = 1 << 16


class RingStore(RunStore):
    """Writes one run of a flight recorder; `ring` is set right after `create`.

    For one thread, as `RunStore`; a second one writes segments anew.
    """

    STEP = 2

    def __init__(self, *arguments: Any, **options: Any) -> None:
        """Takes over a folder; use `create`."""
        super().__init__(*arguments, **options)
        self.ring: RingLedger
        self._manifest: dict[str, Any] = {}
        self._firsts: dict[str, int] = {}  # number of each stream's first segment
        self._entry: dict[str, Any] = {}  # `keep` as of the last time that rows were dropped
        self._sizes: dict[str, dict[int, int]] = {stream: {} for stream in STREAMS}
        self._last_dropped: Any = np.zeros(0, np.int64)
        self._worker: threading.Thread | None = None
        self._failure: BaseException | None = None
        self._describing, self._sizing = threading.Lock(), threading.Lock()
        self._trigger = 0.0

    def describe(self, manifest: dict[str, Any]) -> None:
        """Replaces the manifest of the open run; where its streams begin is added."""
        with self._describing:
            self._manifest = manifest
            self._write_manifest()

    def _write_manifest(self) -> None:
        if not self._entry:
            self._entry = self.ring.to_json()
        segments = {
            stream: {"first": self._firsts.get(stream, 0), "step": self.STEP} for stream in STREAMS
        }
        super().describe({**self._manifest, "keep": self._entry, "segments": segments})

    def append(self, stream: str, batch: pa.RecordBatch) -> None:
        """Hands a batch to the operating system; see `RunStore.append`."""
        self._check_worker()
        super().append(stream, batch)
        if stream == "episodes" and self._size() >= self._limit(FULL):
            self._write_anew()

    def _count(self, stream: str, batch: pa.RecordBatch) -> None:
        self.ring.add(stream, batch)

    def _limit(self, part: float) -> float:
        return max(part * self.ring.rule.most_bytes, self._trigger)

    def _size(self) -> int:
        """Bytes of all segments that count."""
        closed = sum(sum(sizes.values()) for sizes in self._sizes.values())
        return closed + sum(writer.size for writer in self._writers.values())

    def _end_segment(self, stream: str) -> None:
        """Finishes the open segment, and counts its bytes."""
        writer = self._writers.pop(stream)
        writer.finish()
        with self._sizing:
            self._sizes[stream][self._counts[stream] - self.STEP] = writer.size

    def _check_worker(self) -> None:
        if self._failure is not None:
            raise self._failure

    # -- old segments written anew

    def _write_anew(self) -> None:
        """Begins to write what stays, unless that is under way; waits where the size is reached."""
        if self._worker is not None and self._worker.is_alive():
            if self._size() < self._limit(CROWDED):
                return
            self._worker.join()
        self._check_worker()
        for stream in list(self._writers):
            self._end_segment(stream)
        dropped, entry = self.ring.drop(), self.ring.to_json()
        current = {stream: self._current(stream) for stream in STREAMS if self._sizes[stream]}
        # one that was written anew, and to which nothing was added since, stays as it is
        old = {stream: numbers for stream, numbers in current.items() if not numbers[-1] % 2}
        self._worker = threading.Thread(
            target=self._run, args=(old, dropped, entry), name="gamekeeper-ring", daemon=True
        )
        self._worker.start()

    def _run(self, old: dict[str, list[int]], dropped: list[int], entry: dict[str, Any]) -> None:
        try:
            self._rewrite(old, np.array(dropped, np.int64), entry)
        except GamekeeperError as error:
            self._failure = error
        except BaseException as error:  # told by the thread that appends next
            self._failure = RunError(
                "dropping episodes failed",
                where=str(self.path),
                actual=repr(error),
                fix="`gamekeeper recover` finalizes the run from its segments",
            )
            self._failure.__cause__ = error

    def _rewrite(self, old: dict[str, list[int]], dropped: Any, entry: dict[str, Any]) -> None:
        """Writes what stays of the segments `old`, numbers by stream, and removes them."""
        # Written, then named by the manifest, then the old ones removed: whoever reads or recovers
        # in between finds every row once.
        anew = {stream: self._anew(stream, numbers, dropped) for stream, numbers in old.items()}
        with self._describing:
            self._firsts |= {stream: numbers[-1] + 1 for stream, numbers in old.items()}
            self._entry = entry
            self._write_manifest()
        for stream, numbers in old.items():
            for number in numbers:
                (self.path / segment_name(stream, number)).unlink(missing_ok=True)
        with self._sizing:
            for stream, size in anew.items():
                first = self._firsts[stream]
                newer = {n: each for n, each in self._sizes[stream].items() if n > first}
                self._sizes[stream] = {first: size, **newer}
        size = sum(anew.values())
        self.ring.resize(size)
        self._trigger = 4 / 3 * size  # what stays may be near the limit: not again at once

    def _anew(self, stream: str, numbers: list[int], dropped: Any) -> int:
        """Writes the rows that stay of a stream's old segments; bytes of the new one.

        It has a number that no reader looks at before the manifest names it.
        """
        path = self.path / segment_name(stream, numbers[-1] + 1)
        writer = SegmentWriter(path, self._schemas[stream])
        try:
            waiting: list[pa.RecordBatch] = []
            for batch in self._batches(stream, numbers):
                left = _without(plain_batch(batch, writer.schema), dropped)
                waiting += [left] if left.num_rows else []
                if sum(each.num_rows for each in waiting) >= BATCH_ROWS:
                    writer.write(_one(waiting))
                    waiting = []
            if waiting or not writer.size:
                writer.write(
                    _one(waiting) if waiting else pa.RecordBatch.from_pylist([], writer.schema)
                )
        finally:
            writer.finish()
        return writer.size

    def _batches(self, stream: str, numbers: list[int]) -> Iterator[pa.RecordBatch]:
        """The batches of a stream's segments of these numbers."""
        for number in numbers:
            path = self.path / segment_name(stream, number)
            reader = SegmentReader(path, stream)
            yield from reader
            if not reader.ended:
                raise RunError(
                    f"{path.name} became shorter while it was being recorded",
                    where=str(path),
                    fix="leave the run's files alone; `gamekeeper recover` keeps what is whole",
                )

    # -- the end

    def settle(self) -> tuple[pa.Table, dict[str, Any]]:
        """Drops what doesn't stay once recording is over; see `RunStore.settle`."""
        if self._worker is not None:
            self._worker.join()
        self._check_worker()
        self._last_dropped = np.array(self.ring.drop(), np.int64)
        for stream in list(self._writers):
            self._end_segment(stream)
        found = self._batches("episodes", self._current("episodes"))
        batches = [_without(plain_batch(each, EPISODES), self._last_dropped) for each in found]
        self._rows = merged_episodes(batches)
        return self._rows, {"keep": self.ring.to_json()}

    def _current(self, stream: str) -> list[int]:
        """Numbers of a stream's segments, in their order."""
        # Even numbers are segments as they were recorded, the odd one in front was written anew.
        first = self._firsts.get(stream, 0)
        behind = range(first + first % 2, self._counts[stream], self.STEP)
        return [*([first] if first % 2 else []), *behind]

    def _finalize(self, manifest: dict[str, Any]) -> None:
        files: dict[str, tuple[Path, int, str]] = {}
        for stream in ROLLED:
            numbers = self._current(stream)
            if numbers and stream in self._schemas:
                rows = (_without(b, self._last_dropped) for b in self._batches(stream, numbers))
                files[stream] = write_table(self.path, stream, self._schemas[stream], rows)
        if self._rows is not None and self._counts["episodes"]:
            files["episodes"] = write_episodes(self.path, self._rows, level=manifest.get("level"))
        commit(self.path, manifest, files, durable=self._durable)

    def abandon(self) -> None:
        """Closes the files and leaves them as they are: open, readable, recoverable."""
        if self._worker is not None:
            self._worker.join()
        super().abandon()


def create_ring(
    path: Path, manifest: dict[str, Any], ring: RingLedger, *, durable: bool = True
) -> RingStore:
    """Makes the folder of a run that stays within a size; see `RunStore.create`.

    Raises:
        RunError: something lies there already, or the disk refuses.
    """
    store = RingStore.create(path, manifest, durable=durable)
    store.ring = ring
    store.describe(manifest)
    return store


def _without(batch: pa.RecordBatch, dropped: Any) -> pa.RecordBatch:
    """The rows of a batch whose episode isn't in `dropped`."""
    if not len(dropped):
        return batch
    return batch.filter(pa.array(~np.isin(batch["episode"].to_numpy(), dropped)))


def _one(batches: list[pa.RecordBatch]) -> pa.RecordBatch:
    """The batches as one."""
    return pa.Table.from_batches(batches).combine_chunks().to_batches()[0]
