"""Rows of many copies: each keeps a tape of its own, finished episodes become columns together."""

from __future__ import annotations

import base64
import itertools
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pyarrow as pa

from gamekeeper.core.block import most_rows
from gamekeeper.core.layout import Layout
from gamekeeper.core.press import Press, Pressed
from gamekeeper.core.tape import TURN, EpisodeEnd, EpisodeStart, Reel, Tape, take
from gamekeeper.run.held_back import HeldBack

FLUSH_TURNS: Final = 4096
"""Turns of finished episodes that wait to become columns together."""
FLUSH_S: Final = 0.5
"""How long a finished episode waits at most, once another one is over: it is lost by a kill."""
LONG_TURNS: Final = 4096
"""Turns of one episode in progress that become columns before it is over."""

Batches = list[tuple[str, pa.RecordBatch]]
"""Streams and batches, in the order in which they are written."""


@dataclass(slots=True)
class SlotSink:
    """What one copy's game puts its rows onto; the shelf takes them from there."""

    shelf: Shelf
    rings: None = None
    tape: Tape = field(default_factory=Tape)

    @property
    def layout(self) -> Layout:
        """The same for all copies."""
        return self.shelf.layout

    def keep_up(self) -> None:
        """An episode that is over goes onto the shelf; of a long one, what there is."""
        if self.tape.ends or len(self.tape.turns) >= LONG_TURNS * TURN:
            self.shelf.put(self.tape)

    def frame(self, episode: int, turn: int, frame: Any) -> None:
        """Nobody asks for frames of many copies."""


class Shelf:
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
        self.layout = Layout(terms)
        self._press = Press(self.layout, _never, level=level, volatile=volatile)
        self._out = out
        self._waiting: list[tuple[int, Reel]] = []
        self._turns = 0
        self._flushed_s = time.monotonic()

    def put(self, tape: Tape) -> None:
        """Takes what a copy's tape holds; it is all of one episode."""
        rows = most_rows([*self.layout.columns("obs"), *self.layout.columns("action")])
        with HeldBack():  # rows that left the tape get to where they are written
            while (reel := take(tape, most=LONG_TURNS, most_rows=rows)) is not None:
                self._waiting.append((_episode_of(reel), reel))
                self._turns += len(reel.turns) // TURN
            if self._turns >= FLUSH_TURNS or time.monotonic() - self._flushed_s > FLUSH_S:
                self._flush()

    def flush(self) -> None:
        """All that waits becomes columns."""
        with HeldBack():
            self._flush()

    def _flush(self) -> None:
        waiting, self._waiting, self._turns = self._waiting, [], 0
        self._flushed_s = time.monotonic()
        if waiting:
            waiting.sort(key=lambda each: each[0])  # stable: parts of an episode stay in order
            pressed: Pressed = self._press.press(_joined([reel for _, reel in waiting]))
            self._out(list(pressed.in_order()))


def _episode_of(reel: Reel) -> int:
    if reel.turns:
        number: Any = reel.turns[0]  # the first field of a mark
        return int(number)
    parts: list[EpisodeStart | EpisodeEnd] = [*reel.starts, *reel.ends]
    return parts[0].episode


def _joined(reels: list[Reel]) -> Reel:
    given: list[object] = []
    done: list[object] = []
    turns: list[object] = []
    starts: list[EpisodeStart] = []
    ends: list[EpisodeEnd] = []
    for reel in reels:
        given.extend(reel.given)
        done.extend(reel.done)
        turns.extend(reel.turns)
        starts.extend(reel.starts)
        ends.extend(reel.ends)
    return Reel(given, done, turns, starts, ends)


def _never(place: int, out: Any) -> None:
    raise AssertionError("nothing is put aside: there are no rings")


class InOrder:
    """Puts the batches of several blocks into one order: episode by episode, whoever was first."""

    def __init__(self, write: Callable[[str, pa.RecordBatch], None], *, first: int = 0) -> None:
        """`write` takes a stream's name and a batch whose episodes follow those before."""
        self._write = write
        self._next = first
        self._held: dict[int, dict[str, list[pa.RecordBatch]]] = {}
        self._over: set[int] = set()

    def take(self, batches: Batches) -> None:
        """Holds what came, and writes the episodes whose turn it is."""
        for stream, batch in batches:
            for episode, rows in _by_episode(batch):
                self._held.setdefault(episode, {}).setdefault(stream, []).append(rows)
                if stream == "episodes" and rows["end"].null_count < rows.num_rows:
                    self._over.add(episode)
        ready = []
        while self._next in self._over:
            ready.append(self._next)
            self._next += 1
        self._put(ready)

    def finish(self) -> None:
        """Writes what is held back yet; some slot never came to the episodes before."""
        with HeldBack():
            self._put(sorted(self._held))

    def _put(self, episodes: list[int]) -> None:
        held = [self._held.pop(episode) for episode in episodes]
        self._over.difference_update(episodes)
        starts = [each["episodes"][:1] for each in held]
        ends = [each["episodes"][1:] for each in held]
        for stream, parts in (
            ("episodes", starts),
            *((name, [each.get(name, []) for each in held]) for name in _ROWS),
            ("episodes", ends),
        ):
            batches = [batch for part in parts for batch in part]
            for batch in _merged(batches):
                self._write(stream, batch)


class AsTheyCome:
    """Writes batches whose episodes are in order already; in place of `InOrder`."""

    def __init__(self, write: Callable[[str, pa.RecordBatch], None]) -> None:
        """`write` as `InOrder` takes it."""
        self._write = write

    def take(self, batches: Batches) -> None:
        """Writes what came."""
        for stream, batch in batches:
            self._write(stream, batch)

    def finish(self) -> None:
        """Nothing is held back."""


_ROWS: Final = ("steps", "states", "timings")


def _by_episode(batch: pa.RecordBatch) -> list[tuple[int, pa.RecordBatch]]:
    episodes = batch["episode"].to_numpy()
    bounds = [0, *(np.flatnonzero(np.diff(episodes)) + 1).tolist(), len(episodes)]
    return [
        (int(episodes[first]), batch.slice(first, last - first))
        for first, last in itertools.pairwise(bounds)
        if last > first
    ]


def _merged(batches: list[pa.RecordBatch]) -> list[pa.RecordBatch]:
    """Batches of equal columns in a row as one."""
    merged: list[pa.RecordBatch] = []
    run: list[pa.RecordBatch] = []
    for batch in [*batches, None]:
        if run and (batch is None or batch.schema != run[0].schema):
            merged += pa.Table.from_batches(run).combine_chunks().to_batches()
            run = []
        if batch is not None:
            run.append(batch)
    return merged


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
    """How copies are recorded.

    Attributes:
        level: `full` or `digest`.
        terms: reward terms by name.
        volatile: info fields that stay out of the info fingerprint.
    """

    level: str = "full"
    terms: tuple[str, ...] = ()
    volatile: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "level": self.level, "terms": list(self.terms), "volatile": list(self.volatile),
        }  # fmt: skip

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Recording:
        """From plain data."""
        return cls(data["level"], tuple(data["terms"]), tuple(data["volatile"]))

    def shelf(self, out: Callable[[Batches], None]) -> Shelf:
        """A shelf that keeps rows so."""
        return Shelf(out, level=self.level, terms=self.terms, volatile=self.volatile)
