"""Rows of many sub-environments: a buffer each; finished episodes become columns together."""

from __future__ import annotations

import base64
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.episodes.arrow import turn_bounds
from gamekeeper.episodes.block import most_rows
from gamekeeper.episodes.buffer import (
    TURN,
    Buffer,
    BufferedTurns,
    EpisodeEnd,
    EpisodeStart,
    UsualRows,
    take,
)
from gamekeeper.episodes.encoder import Encoded, Encoder
from gamekeeper.episodes.layout import Layout, leaf_columns
from gamekeeper.episodes.plain_json import fields_json
from gamekeeper.episodes.tables import table_of
from gamekeeper.rollouts.interrupts import HeldInterrupt

FLUSH_TURNS: Final = 4096
"""Turns of finished episodes that wait to become columns together."""
FLUSH_S: Final = 0.5
"""Seconds that a finished episode waits at most once another is over: a kill loses it."""
LONG_TURNS: Final = 4096
"""Turns of one episode in progress that become columns before it is over."""

Batches = list[tuple[str, pa.RecordBatch]]
"""Streams and batches, in the order in which they are written."""


@dataclass(slots=True)
class SlotSink:
    """Sink for the rows of one sub-environment's capture."""

    shelf: RowShelf
    rings: None = None
    buffer: Buffer = field(default_factory=Buffer)

    @property
    def layout(self) -> Layout:
        """The same for all copies."""
        return self.shelf.layout

    @property
    def level(self) -> str:
        """Level of the run."""
        return self.shelf.level

    def keep_up(self) -> None:
        """An episode that is over goes onto the shelf; of a long one, what there is."""
        if self.buffer.ends or len(self.buffer.turns) >= LONG_TURNS * TURN:
            self.shelf.put(self.buffer)

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Ignores frames: they aren't recorded for many sub-environments."""


class RowShelf:
    """Collects the rows of a block's copies and hands them out as batches, episode by episode."""

    def __init__(
        self,
        out: Callable[[Batches], None],
        *,
        level: str,
        terms: tuple[str, ...] = (),
        volatile: Collection[str] = (),
    ) -> None:
        """`out` takes the batches, of which each has its episodes in order."""
        self.layout, self.level = Layout(terms), level
        self._encoder = Encoder(self.layout, never, level=level, volatile=volatile)
        self._out = out
        self._waiting: list[tuple[int, BufferedTurns]] = []
        self._turns = 0
        self._rows_of = -1, 0  # number of agents, and of rows that are taken at a time
        self._flushed_s = time.monotonic()

    def put(self, buffer: Buffer) -> None:
        """Takes what a copy's buffer holds; it is all of one episode."""
        rows = self._most_rows()
        with HeldInterrupt():  # rows that left the buffer get to where they are written
            while buffer.turns or buffer.ends or buffer.starts:
                buffered = take(buffer, most=LONG_TURNS, most_rows=rows)
                if buffered is None:
                    break
                self._waiting.append((_episode_of(buffered), buffered))
                self._turns += len(buffered.turns) // TURN
            if self._turns >= FLUSH_TURNS or time.monotonic() - self._flushed_s > FLUSH_S:
                self._flush()

    def _most_rows(self) -> int:
        agents = len(self.layout.order)
        if self._rows_of[0] != agents:  # columns only come with agents
            columns = [*self.layout.columns("obs"), *self.layout.columns("action")]
            self._rows_of = agents, most_rows(columns)
        return self._rows_of[1]

    def flush(self) -> None:
        """All that waits becomes columns."""
        with HeldInterrupt():
            self._flush()

    def _flush(self) -> None:
        waiting, self._waiting, self._turns = self._waiting, [], 0
        self._flushed_s = time.monotonic()
        if waiting:
            waiting.sort(key=lambda each: each[0])  # stable: parts of an episode stay in order
            encoded: Encoded = self._encoder.encode_turns(
                _joined([buffered for _, buffered in waiting])
            )
            self._out(list(encoded.in_order()))


def _episode_of(buffered: BufferedTurns) -> int:
    if buffered.turns:
        number: Any = buffered.turns[0]  # the first field of a mark
        return int(number)
    parts: list[EpisodeStart | EpisodeEnd] = [*buffered.starts, *buffered.ends]
    return parts[0].episode


def _joined(buffered_parts: list[BufferedTurns]) -> BufferedTurns:
    given: list[object] = []
    done: list[object] = []
    turns: list[object] = []
    starts: list[EpisodeStart] = []
    ends: list[EpisodeEnd] = []
    usual = UsualRows()
    for buffered in buffered_parts:
        given.extend(buffered.given)
        done.extend(buffered.done)
        turns.extend(buffered.turns)
        starts.extend(buffered.starts)
        ends.extend(buffered.ends)
        usual.agents.extend(buffered.usual.agents)
        usual.actions.extend(buffered.usual.actions)
        usual.rewards.extend(buffered.usual.rewards)
    return BufferedTurns(given, done, turns, starts, ends, usual)


def never(place: int, out: Any) -> None:
    """Opens an observation that was put aside, which no sub-environment does."""
    raise AssertionError("nothing is put aside: there are no rings")


class InOrder:
    """Writes batches of many sub-environments episode by episode, whoever was first.

    Args:
        write: takes a stream's name and a batch whose episodes follow those before.
    """

    def __init__(self, write: Callable[[str, pa.RecordBatch], None]) -> None:
        self._write, self._next = write, 0
        self._held: dict[str, list[pa.RecordBatch]] = {name: [] for name in _WRITTEN}
        self._over = np.zeros(0, np.int64)

    def take(self, batches: Batches) -> None:
        """Holds what came, sorted by episode each, and writes the episodes whose turn it is."""
        for stream, batch in batches:
            is_end = stream == "episodes" and batch["end"].null_count < batch.num_rows
            self._held["ends" if is_end else stream].append(batch)
            if is_end:
                self._over = np.union1d(self._over, batch["episode"].to_numpy())
        follows = self._over == self._next + np.arange(len(self._over))
        count = int(np.logical_and.accumulate(follows).sum())
        if count:
            self._next += count
            self._over = self._over[count:]
            self._put(self._next)

    def finish(self) -> None:
        """Writes what is held back yet; some slot never came to the episodes before."""
        with HeldInterrupt():
            self._put(np.iinfo(np.int32).max)

    def _put(self, bound: int) -> None:
        """Writes the episodes before `bound`."""
        for stream in _WRITTEN:
            table = self._taken(stream, bound)
            if table is not None:
                for batch in _cut(table):
                    self._write("episodes" if stream == "ends" else stream, batch)

    def _taken(self, stream: str, bound: int) -> pa.Table | None:
        """The rows of episodes before `bound`, in their order; parts of one stay in theirs."""
        taken, left = [], []
        for batch in self._held[stream]:
            count = int(np.searchsorted(batch["episode"].to_numpy(), bound))
            if count:
                taken.append(batch.slice(0, count))
            if count < batch.num_rows:
                left.append(batch.slice(count))
        self._held[stream] = left
        if not taken:
            return None
        table = table_of(taken)
        episode = table["episode"].to_numpy()
        if (np.diff(episode) < 0).any():
            table = table.take(pa.array(np.argsort(episode, kind="stable")))
        return table.combine_chunks()


_WRITTEN: Final = ("episodes", "agent_steps", "states", "timings", "ends")


def _cut(table: pa.Table) -> list[pa.RecordBatch]:
    """Batches of at most so many rows as one block may hold, of whole turns."""
    most = most_rows(leaf_columns(table.schema))
    if table.num_rows <= most:
        return list(table.to_batches())
    parts = [table.slice(start, end - start) for start, end in turn_bounds(table, most)]
    return [batch for part in parts for batch in part.combine_chunks().to_batches()]


def to_text(batches: Batches) -> list[list[str]]:
    """Batches as texts that cross between processes."""
    texts = []
    for stream, batch in batches:
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, batch.schema) as writer:
            writer.write_batch(batch)
        texts.append([stream, base64.b64encode(sink.getvalue()).decode()])
    return texts


def from_text(texts: list[list[str]]) -> Batches:
    """The batches from texts that crossed."""
    found: Batches = []
    for stream, text in texts:
        with pa.ipc.open_stream(base64.b64decode(text)) as reader:
            found += [(stream, batch) for batch in reader]
    return found


@dataclass(frozen=True, slots=True)
class Recording:
    """Options of recording sub-environments.

    Attributes:
        level: `full` or `digest`.
        volatile: info fields that stay out of the info fingerprint.
    """

    level: str = "full"
    terms: tuple[str, ...] = ()
    volatile: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return fields_json(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Recording:
        """From plain data."""
        return cls(data["level"], tuple(data["terms"]), tuple(data["volatile"]))

    def shelf(self, out: Callable[[Batches], None]) -> RowShelf:
        """A shelf that keeps rows so."""
        return RowShelf(out, level=self.level, terms=self.terms, volatile=self.volatile)
