"""One episode from its front, some whole turns at a time: a long one is never whole in memory."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.core.block import element_bytes
from gamekeeper.core.leaf_columns import leaf_columns
from gamekeeper.core.legible import legible
from gamekeeper.core.space import Codec
from gamekeeper.core.trace import Spaces, Trace

ROWS: Final = 16_384
"""Of a stretch: few enough for memory, enough that what it costs beside its rows is little."""
STRETCH_BYTES: Final = 64 << 20
"""Of the values in a stretch, unless a single turn has more."""


class Front:
    """The rows of one stream of an episode, which are taken off from its front.

    Args:
        parts: the rows, sorted by turn.
    """

    def __init__(self, parts: Iterable[pa.Table] = ()) -> None:
        self._parts = iter(parts)
        self._rows: pa.Table | None = None

    def add(self, rows: pa.Table) -> None:
        """Puts rows behind those that are there; columns may have come or gone."""
        kept = self._rows
        if kept is not None:
            rows = pa.concat_tables([kept, rows], promote_options="default")
        self._rows = rows

    @property
    def schema(self) -> pa.Schema | None:
        """The columns of what comes next; None where nothing ever came."""
        if self._rows is None:
            self._pull()
        return None if self._rows is None else self._rows.schema

    @legible
    def bound(self, rows: int) -> int | None:
        """The turn before which about so many rows stand; None where no more are left."""
        while (self._rows is None or self._rows.num_rows <= rows) and self._pull():
            pass
        if self._rows is None or self._rows.num_rows <= rows:
            return None
        turns = self._rows["turn"]
        return max(int(turns[rows].as_py()), int(turns[0].as_py()) + 1)

    @legible
    def take(self, before: int | None) -> pa.Table | None:
        """The rows up to the first of turn `before` or a later one; None: all that are left.

        Returns:
            None where nothing ever came.
        """
        taken: list[pa.Table] = []
        while self._rows is not None or self._pull():
            rows: pa.Table = self._rows
            count = rows.num_rows if before is None else _leading(rows, before)
            taken.append(rows.slice(0, count))
            # its columns stay, so that no rows are still a table
            self._rows = rows.slice(count)
            if count < rows.num_rows or not self._pull():
                break
        return pa.concat_tables(taken, promote_options="default") if taken else None

    def _pull(self) -> bool:
        part = next(self._parts, None)
        if part is not None:
            self.add(part)
        return part is not None


@dataclass(frozen=True, slots=True)
class Strip:
    """One episode: its header, and its rows from the front.

    Attributes:
        episode: its number in the run.
        header: its row in `episodes`, with the number of its turns.
        spaces: the codecs of each agent.
        state_codec: the codec of `state()`.
        steps: rows of `steps`.
        states: rows of `states`; None where none are recorded.
        empty: the columns of `steps` where it has no row.
    """

    episode: int
    header: Mapping[str, Any]
    spaces: Mapping[str, Spaces]
    state_codec: Codec | None
    steps: Front
    states: Front | None
    empty: pa.Schema

    @legible
    def take(self, before: int | None) -> Trace:
        """The turns below `before`, or all that are left, as a trace."""
        steps = self.steps.take(before)
        return Trace(
            episode=self.episode,
            header=self.header,
            steps=steps if steps is not None and steps.num_rows else self.empty.empty_table(),
            states=None if self.states is None else self.states.take(before),
            spaces=self.spaces,
            state_codec=self.state_codec,
        )

    def stretches(self, rows: int | None = None) -> Iterator[tuple[Trace, int | None]]:
        """The turns, at most about `rows` rows at a time, each with the turn that comes next.

        The last has None in its place; it may be empty.
        """
        fronts = [front for front in (self.steps, self.states) if front is not None]
        rows = rows_of([front.schema for front in fronts], ROWS if rows is None else rows)
        while (before := self.steps.bound(rows)) is not None:
            yield self.take(before), before
        yield self.take(None), None


def rows_of(schemas: Collection[pa.Schema | None], rows: int) -> int:
    """How many rows of these columns, at most `rows`, a stretch may hold."""
    sizes = [
        element_bytes(column)
        for schema in schemas
        if schema is not None
        for column in leaf_columns(schema)
        if column.leaf.kind not in ("text", "json")
    ]
    return max(1, min(rows, STRETCH_BYTES // max(1, sum(sizes))))


def _leading(rows: pa.Table, before: int) -> int:
    """How many rows stand before the first one of turn `before` or a later one."""
    later = np.flatnonzero(rows["turn"].to_numpy() >= before)
    return int(later[0]) if len(later) else int(rows.num_rows)
