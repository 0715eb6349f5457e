"""The files of an open bundle's streams, and which of their rows belong to whole turns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.core.merge import merge
from gamekeeper.errors import BundleError
from gamekeeper.record.files.folder import inside, reading
from gamekeeper.record.files.limits import check_memory, row_bytes
from gamekeeper.record.files.schema import Keys, key_arrays, plain_batch, plain_schema, unify
from gamekeeper.record.files.segment_reader import SegmentReader
from gamekeeper.record.files.segments import SEGMENT, Cut
from gamekeeper.record.files.table_reader import TableReader
from gamekeeper.record.files.whole import Whole, whole_turns


class StreamFiles:
    """The files of one stream in an open bundle: its Parquet file if it has one, else segments.

    `schema` and `cuts` are known once `batches` has run to its end.
    """

    __slots__ = ("cuts", "folder", "salvage", "schema", "stream")

    def __init__(self, folder: Path, stream: str, *, salvage: bool) -> None:
        self.folder, self.stream, self.salvage = folder, stream, salvage
        self.schema: pa.Schema | None = None
        self.cuts: list[Cut] = []

    def batches(self) -> Iterator[pa.RecordBatch]:
        """Every whole batch, in the order of writing."""
        self.schema, self.cuts = None, []
        table = inside(self.folder, f"{self.stream}.parquet")
        if table.exists():
            whole = TableReader(table, self.stream)
            self._widen(whole.schema)
            yield from whole.batches()
            return  # written from the segments that may still lie beside it
        paths = self._segments()
        for i, path in enumerate(paths):
            reader = SegmentReader(path, self.stream, salvage=self.salvage)
            for batch in reader:
                self._widen(batch.schema)
                yield batch
            if reader.schema is not None:
                self._widen(reader.schema)
            rest = len(paths) - 1 - i
            if reader.cut:
                self.cuts.append(reader.cut)
            if rest and not reader.ended:
                why = f"not ended regularly, so {rest} later segments of {self.stream} don't count"
                self.cuts.append(Cut(path.name, path.stat().st_size, why))
                return

    def exists(self) -> bool:
        """True where the stream has a file, even one that was cut before its first batch."""
        return inside(self.folder, f"{self.stream}.parquet").exists() or bool(self._found())

    def _found(self) -> dict[int, Path]:
        """The segments by their numbers."""
        found: dict[int, Path] = {}
        with reading(self.folder):
            for path in self.folder.iterdir():
                match = SEGMENT.fullmatch(path.name)
                if match and match[1] == self.stream:
                    found[int(match[2])] = inside(self.folder, path.name)
        return found

    def _segments(self) -> list[Path]:
        """The segments in order, from the first up to a gap."""
        found, paths = self._found(), []
        for number in range(len(found)):
            if number not in found:
                self._missing(number)
                break
            paths.append(found[number])
        return paths

    def table(self) -> pa.Table | None:
        """All batches in one table, None where the stream has no file with a schema."""
        batches, size = [], 0
        for batch in self.batches():
            batches.append(batch)
            size += batch.nbytes
            with reading(self.folder / self.stream):
                check_memory(size)
        if self.schema is None:
            return None
        schema = plain_schema(self.schema)
        with reading(self.folder / self.stream):
            rows = sum(batch.num_rows for batch in batches)
            check_memory(rows * sum(row_bytes(field.type) for field in schema))
            return pa.Table.from_batches([plain_batch(batch, schema) for batch in batches], schema)

    def _widen(self, schema: pa.Schema) -> None:
        if self.schema is None:
            self.schema = schema
        elif not schema.equals(self.schema, check_metadata=True):
            self.schema = unify(self.schema, schema, where=str(self.folder / self.stream))

    def _missing(self, number: int) -> None:
        name = f"{self.stream}-{number:04d}.arrows"
        if not self.salvage:
            raise BundleError(
                f"{name} is missing",
                where=str(self.folder / name),
                mend="restore the file from a copy; `gamekeeper recover` keeps the turns before it",
            )
        self.cuts.append(Cut(name, 0, "the segment is missing"))


def whole_of(streams: dict[str, Iterable[pa.RecordBatch]]) -> Whole:
    """The whole turns of a run.

    Args:
        streams: by name, the batches of each stream that exists.
    """
    keys = {name: _keys(name, batches) for name, batches in streams.items()}
    nothing = np.zeros(0, np.int64)
    episode, turn, acted = keys.get("steps", (nothing, nothing, nothing))
    begun = keys["episodes"][0] if "episodes" in keys else nothing
    states, timings = (keys[name][:2] if name in keys else None for name in ("states", "timings"))
    return whole_turns(begun, (episode, turn, acted.astype(bool)), states, timings)


def keep(whole: Whole, stream: str, batch: pa.RecordBatch | pa.Table) -> pa.Array:
    """[rows] which rows of a stream belong to whole turns."""
    kept = {"steps": whole.steps, "states": whole.states, "timings": whole.timings}[stream]
    return pa.array(kept(*key_arrays(batch, stream, where=stream)))


def merge_whole(table: pa.Table, whole: Whole) -> pa.Table:
    """One row an episode, as `merge` has it; a row that tells an end needs that many whole turns.

    Args:
        table: the rows of the stream in the order of writing.
    """
    episode, _ = key_arrays(table, "episodes", where="episodes")
    if "turns" not in table.column_names:
        return merge(table)
    at, _ = whole.place(episode)
    return merge(table, counts=table["turns"].fill_null(0).to_numpy() <= whole.turns[at])


def _keys(stream: str, batches: Iterable[pa.RecordBatch]) -> tuple[Keys, Keys, Keys]:
    """[rows] episode, turn, and whether the agent acted (0 where the stream has no orders)."""
    parts = []
    for batch in batches:
        episode, turn = key_arrays(batch, stream, where=stream)
        acted = np.zeros_like(episode)
        if "order" in batch.schema.names:
            acted = np.asarray(pc.is_valid(batch.column("order"))).astype(np.int64)
        parts.append((episode, turn, acted))
    parts.append((np.zeros(0, np.int64),) * 3)
    episode, turn, acted = (np.concatenate(part) for part in zip(*parts, strict=True))
    return episode, turn, acted
