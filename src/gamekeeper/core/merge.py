"""Record batches put together: tables whose columns grew, episodes from their two rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.core.press import EPISODES


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
