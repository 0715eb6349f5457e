"""Record batches put together: tables whose columns grew, episodes from their two rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pyarrow as pa

from gamekeeper.core.press import EPISODES


def table_of(batches: Sequence[pa.RecordBatch]) -> pa.Table:
    """One table over `batches`; a column that some of them lack is null there."""
    return pa.concat_tables(
        [pa.Table.from_batches([batch]) for batch in batches], promote_options="default"
    )


def merged_episodes(batches: Sequence[pa.RecordBatch]) -> pa.Table:
    """One row for each episode from its row at the start and, once it ended, the one at its end."""
    merged: dict[int, dict[str, Any]] = {}
    for batch in batches:
        for row in batch.to_pylist():
            known = merged.setdefault(row["episode"], {})
            known.update({name: value for name, value in row.items() if value is not None})
    rows = [merged[episode] for episode in sorted(merged)]
    return pa.Table.from_pylist(rows, schema=EPISODES)
