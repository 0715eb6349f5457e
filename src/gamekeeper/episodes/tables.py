"""The tables of a run, wherever they lie: read whole, by column, or an episode at a time."""

from bisect import bisect_left
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.episodes.encoder import EPISODES

PART_ROWS: Final = 1 << 17
"""Rows in a part of a stream; as many as a row group of a run has."""
PART_BYTES: Final = 32 << 20
"""Bytes of a part, unless one row has more."""


class Tables(Protocol):
    """The streams of one run: `episodes`, `steps`, `states`, `timings`."""

    def table(self, stream: str, *, without: Collection[str] = ()) -> pa.Table | None:
        """A whole stream, sorted by episode and turn; None where it wasn't recorded.

        `without` names kinds of columns that aren't needed ("obs").
        """

    def episode(self, stream: str, episode: int) -> pa.Table | None:
        """The rows of one episode of a stream."""

    def parts(
        self, stream: str, episode: int, *, columns: Collection[str] | None = None
    ) -> Iterator[pa.Table] | None:
        """The rows of one episode, some columns of them, part by part; None as with `table`.

        At least one part comes, which may be empty.
        """

    def all_parts(self, stream: str, *, without: Collection[str] = ()) -> Iterator[pa.Table] | None:
        """A whole stream, but for columns of the kinds in `without`, part by part; None as above.

        At least one part comes, which may be empty.
        """

    def has(self, stream: str) -> bool:
        """True if the stream was recorded."""


@dataclass(frozen=True, slots=True)
class MemoryTables:
    """Streams that are in memory already."""

    tables: Mapping[str, pa.Table]

    def table(self, stream: str, *, without: Collection[str] = ()) -> pa.Table | None:
        """A whole stream."""
        table = self.tables.get(stream)
        if table is None or not without:
            return table
        return table.select([name for name in table.schema.names if kind_of(name) not in without])

    def episode(self, stream: str, episode: int) -> pa.Table | None:
        """The rows of one episode of a stream."""
        table = self.tables.get(stream)
        return None if table is None else episode_rows(table, episode)

    def parts(
        self, stream: str, episode: int, *, columns: Collection[str] | None = None
    ) -> Iterator[pa.Table] | None:
        """The rows of one episode, some columns of them, part by part."""
        rows = self.episode(stream, episode)
        if rows is None:
            return None
        if columns is not None:
            rows = rows.select([name for name in rows.schema.names if name in columns])
        return _parts_of(rows)

    def all_parts(self, stream: str, *, without: Collection[str] = ()) -> Iterator[pa.Table] | None:
        """A whole stream, part by part."""
        table = self.table(stream, without=without)
        return None if table is None else _parts_of(table)

    def has(self, stream: str) -> bool:
        """True if the stream was recorded."""
        return stream in self.tables


def _parts_of(table: pa.Table) -> Iterator[pa.Table]:
    row_bytes = table.nbytes // max(table.num_rows, 1)
    rows = max(1, min(PART_ROWS, PART_BYTES // max(row_bytes, 1)))
    return (table.slice(start, rows) for start in range(0, max(table.num_rows, 1), rows))


def episode_rows(table: pa.Table, episode: int) -> pa.Table:
    """The rows of one episode of a table that is sorted by episode, without a copy of any.

    A recording that is still open has a chunk for each flush, thousands of them: only the chunks in
    which the episode begins and ends are looked at.
    """
    first, last = (_rows_below(table["episode"], number) for number in (episode, episode + 1))
    return table.slice(first, last - first)


def _rows_below(keys: pa.ChunkedArray, bound: int) -> int:
    """Number of the sorted `keys` that are less than `bound`."""
    chunks = [chunk for chunk in keys.chunks if len(chunk)]
    place = bisect_left(chunks, bound, key=lambda chunk: chunk[-1].as_py())
    before = sum(map(len, chunks[:place]))
    if place == len(chunks):
        return before
    # Keys of Python's own integers would have numpy turn the whole chunk into 64 bits first.
    values = chunks[place].to_numpy(zero_copy_only=False)
    return before + int(values.searchsorted(np.asarray(bound, values.dtype)))


def kind_of(column: str) -> str:
    """`obs` for `obs.<path>@<group>`."""
    return column.split("@")[0].split(".")[0]


def table_of(batches: Sequence[pa.RecordBatch]) -> pa.Table:
    """One table over `batches`; a column that some of them lack is null there."""
    return pa.concat_tables(
        [pa.Table.from_batches([batch]) for batch in batches], promote_options="default"
    )


def merged_episodes(batches: Sequence[pa.RecordBatch]) -> pa.Table:
    """One row for each episode from its row at the start and, once it ended, the one at its end."""
    return merge(pa.Table.from_batches(batches, EPISODES))


def merge(table: pa.Table, *, counts: npt.NDArray[np.bool_] | None = None) -> pa.Table:
    """One row for each episode, sorted: of each column the last value that isn't null.

    Args:
        table: rows with an `episode` in each, in the order of writing.
        counts: [rows] whether a row counts; the first of an episode always does. None: all do.
    """
    table = table.combine_chunks()
    ids, first, place = np.unique(
        table["episode"].to_numpy(), return_index=True, return_inverse=True
    )
    use = np.ones(table.num_rows, bool) if counts is None else counts.copy()
    use[first] = True
    columns = []
    for column in table.columns:
        last = np.full(len(ids), -1, np.int64)
        rows = np.flatnonzero(np.asarray(pc.is_valid(column)) & use)
        np.maximum.at(last, place[rows], rows)
        columns.append(column.take(pa.array(last, mask=last < 0)))
    return pa.table(columns, schema=table.schema)
