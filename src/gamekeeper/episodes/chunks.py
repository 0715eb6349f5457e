"""One episode, some whole turns at a time from its start: a long one is never whole in memory."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.episodes.block import most_rows
from gamekeeper.episodes.episode import Episode, Spaces
from gamekeeper.episodes.layout import leaf_columns
from gamekeeper.episodes.plain_json import legible
from gamekeeper.episodes.spaces import Codec

ROWS: Final = 16_384
"""Rows taken at a time: few enough for memory, enough that the cost beside them is little."""


class RowReader:
    """The rows of one stream of an episode, taken off from the first on.

    Args:
        parts: the rows, sorted by turn.
    """

    def __init__(self, parts: Iterable[pa.Table] = ()) -> None:
        self._parts = iter(parts)
        self._rows: pa.Table | None = None

    def add(self, rows: pa.Table) -> None:
        """Puts rows behind those that are there; columns may have come or gone."""
        before = [] if self._rows is None else [self._rows]
        self._rows = pa.concat_tables([*before, rows], promote_options="default")

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
class EpisodeChunks:
    """One episode: its header, and its rows from the first on.

    Attributes:
        header: its row in `episodes`, with the number of its turns.
        states: rows of `states`; None where none are recorded.
        empty: the columns of `steps` where it has no row.
    """

    episode: int
    header: Mapping[str, Any]
    spaces: Mapping[str, Spaces]
    state_codec: Codec | None
    steps: RowReader
    states: RowReader | None
    empty: pa.Schema

    @legible
    def take(self, before: int | None) -> Episode:
        """The turns below `before`, or all that are left, as an episode."""
        steps = self.steps.take(before)
        return Episode(
            episode=self.episode,
            header=self.header,
            steps=steps if steps is not None and steps.num_rows else self.empty.empty_table(),
            states=None if self.states is None else self.states.take(before),
            spaces=self.spaces,
            state_codec=self.state_codec,
        )

    def stretches(self) -> Iterator[tuple[Episode, int | None]]:
        """Yields the turns, at most about `ROWS` rows at a time, each with the turn that follows.

        The last has None in its place; it may be empty.
        """
        readers = [each for each in (self.steps, self.states) if each is not None]
        schemas = [reader.schema for reader in readers if reader.schema is not None]
        columns = [column for schema in schemas for column in leaf_columns(schema)]
        rows = most_rows(columns, ROWS)
        while (before := self.steps.bound(rows)) is not None:
            yield self.take(before), before
        yield self.take(None), None


def _leading(rows: pa.Table, before: int) -> int:
    """Number of rows before the first one of turn `before` or a later one."""
    later = np.flatnonzero(rows["turn"].to_numpy() >= before)
    return int(later[0]) if len(later) else int(rows.num_rows)
