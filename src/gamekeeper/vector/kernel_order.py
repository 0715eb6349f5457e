"""Columns of many copies put into one order: episode by episode, each with its fingerprints."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gamekeeper.core.digest import episode_header
from gamekeeper.core.press import EPISODES
from gamekeeper.kernels.hashing import digests
from gamekeeper.vector.kernel_press import DIGEST, TEXT
from gamekeeper.vector.rows import Batches

SIZE: Final = 16  # bytes of a row's digest
WHOLE: Final = 32  # bytes of an episode's
ZERO: Final = pa.scalar(b"\0", pa.binary())
NIBBLES: Final = np.frombuffer(b"0123456789abcdef", np.uint8)


class Ordered:
    """Holds rows until all episodes before them are over.

    Args:
        level: `full` or `digest`.
        options: what every reset was told, as canonical JSON; None: nothing.
        most_rows: of a batch that is written.
    """

    def __init__(self, *, level: str, options: str | None, most_rows: int) -> None:
        self._level, self._options, self._most_rows = level, options, most_rows
        self._held: dict[str, list[pa.RecordBatch]] = {
            name: [] for name in ("starts", "steps", "states", "ends")
        }
        self._next = 0
        self._over = np.zeros(0, np.int64)

    def add(self, stream: str, batch: pa.RecordBatch | None) -> None:
        """Takes rows of `starts`, `steps`, `states` or `ends`, sorted by episode."""
        if batch is not None and batch.num_rows:
            self._held[stream].append(batch)
            if stream == "ends":
                self._over = np.union1d(self._over, batch["episode"].to_numpy())

    def ready(self) -> Batches:
        """What may be written: the episodes that are over, up to the first that isn't."""
        expected = self._next + np.arange(len(self._over))
        count = int((self._over == expected).argmin()) if len(self._over) else 0
        if len(self._over) and (self._over == expected).all():
            count = len(self._over)
        if not count:
            return []
        self._next += count
        self._over = self._over[count:]
        return self._written(self._next)

    def rest(self) -> Batches:
        """All that is held: some slots never came to the episodes before."""
        self._over = self._over[:0]
        return self._written(np.iinfo(np.int32).max)

    def _written(self, bound: int) -> Batches:
        tables = {name: self._taken(name, bound) for name in self._held}
        starts, ends = tables["starts"], tables["ends"]
        if starts is None or ends is None:
            return []
        numbers = starts["episode"].to_numpy()
        found: Batches = [("episodes", self._started(starts))]
        for stream in ("steps", "states"):
            table = tables[stream]
            if table is not None:
                hidden = [TEXT] if stream == "steps" and self._level == "digest" else [DIGEST, TEXT]
                kept = [name for name in table.schema.names if name not in hidden]
                found += [(stream, part) for part in self._cut(table.select(kept))]
        found.append(("episodes", self._ended(numbers, tables)))
        return found

    def _taken(self, stream: str, bound: int) -> pa.Table | None:
        """The rows of episodes before `bound`, in their order."""
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
        table = pa.Table.from_batches(taken)
        episode = table["episode"].to_numpy()
        if (np.diff(episode) < 0).any():
            table = table.take(pa.array(np.argsort(episode, kind="stable")))
        return table.combine_chunks()

    def _cut(self, table: pa.Table) -> list[pa.RecordBatch]:
        """Batches of at most so many rows, of whole turns."""
        episode, turn = table["episode"].to_numpy(), table["turn"].to_numpy()
        is_first = np.concatenate(([True], (np.diff(episode) != 0) | (np.diff(turn) != 0)))
        firsts, parts, start = np.flatnonzero(is_first), [], 0
        while start < table.num_rows:
            end = table.num_rows
            if end - start > self._most_rows:
                place = int(np.searchsorted(firsts, start + self._most_rows, side="right")) - 1
                place += firsts[place] <= start  # a turn of more rows stays whole
                end = int(firsts[place]) if place < len(firsts) else end
            parts += table.slice(start, end - start).combine_chunks().to_batches()
            start = end
        return parts

    # -- episodes

    def _started(self, starts: pa.Table) -> pa.RecordBatch:
        count = starts.num_rows
        options = pa.nulls(count, pa.string())
        if self._options is not None:
            options = pc.if_else(pa.array(np.ones(count, bool)), self._options, options)
        return _episodes(
            count, episode=starts["episode"], seed=starts["seed"], since=starts["episode"],
            options=options,
        )  # fmt: skip

    def _ended(self, numbers: NDArray[Any], tables: dict[str, pa.Table | None]) -> pa.RecordBatch:
        starts: Any = tables["starts"]
        ends: Any = tables["ends"]
        rows = self._digests(numbers, tables["steps"])
        states = self._digests(numbers, tables["states"])
        before, _, after = episode_header(seed=0, options=self._options).rpartition("0")
        seeds = pc.cast(starts["seed"].combine_chunks(), pa.string())
        header = pc.binary_join_element_wise(before, seeds, after, "").cast(pa.binary())
        parts = (_binary(rows), _binary(states))
        whole = pc.binary_join_element_wise(header, *parts, ZERO)
        data, bounds = _buffer(whole)
        prints = digests(data, bounds.astype(np.int64), WHOLE)
        return _episodes(
            ends.num_rows, episode=ends["episode"], turns=ends["turns"], end=ends["end"],
            endings=ends["endings"], action_types=ends["action_types"], fingerprint=_hex(prints),
            info_fingerprint=_hex(self._infos(numbers, tables["steps"])),
        )  # fmt: skip

    def _digests(self, numbers: NDArray[Any], table: pa.Table | None) -> NDArray[np.uint8]:
        """The digest of the digests of each episode's rows, [episodes, 32]."""
        if table is None:
            return digests(np.zeros(0, np.uint8), np.zeros(len(numbers) + 1, np.int64), WHOLE)
        data, offsets = _buffer(table[DIGEST].combine_chunks())
        data = data[offsets[0] : offsets[-1]]
        bounds = _bounds(numbers, table["episode"].to_numpy())
        return digests(data, bounds * SIZE, WHOLE)

    def _infos(self, numbers: NDArray[Any], table: pa.Table | None) -> NDArray[np.uint8]:
        """The digest of the lines that tell each episode's infos, [episodes, 32]."""
        empty = np.zeros(0, np.uint8), np.zeros(len(numbers) + 1, np.int64)
        if table is None:
            return digests(*empty, WHOLE)
        table = table.select(
            [TEXT if TEXT in table.schema.names else "info", "episode", "turn", "agent"]
        )
        table = table.filter(pc.is_valid(table.column(0))).combine_chunks()
        if not table.num_rows:
            return digests(*empty, WHOLE)
        turn = pc.cast(table["turn"], pa.string())
        lines = pc.binary_join_element_wise(
            turn, "\0", table["agent"], "\0", table.column(0), "\n", ""
        )
        data, offsets = _buffer(lines.combine_chunks())
        bounds = offsets[_bounds(numbers, table["episode"].to_numpy())]
        return digests(data, bounds.astype(np.int64), WHOLE)


def _bounds(numbers: NDArray[Any], episode: NDArray[Any]) -> NDArray[np.int64]:
    """Where the rows of each of the episodes begin, and the last one's end."""
    first = np.searchsorted(episode, numbers).astype(np.int64)
    return np.concatenate((first, [len(episode)]))


def _buffer(array: Any) -> tuple[NDArray[np.uint8], NDArray[Any]]:
    """The bytes of a column without nulls, and where each value begins and the last ends."""
    if isinstance(array, pa.ChunkedArray):
        array = pa.concat_arrays(array.chunks)
    buffers, first, count = array.buffers(), array.offset, len(array)
    if pa.types.is_fixed_size_binary(array.type):
        size = array.type.byte_width
        return np.frombuffer(buffers[1], np.uint8), (first + np.arange(count + 1)) * size
    kind = np.int64 if pa.types.is_large_binary(array.type) else np.int32
    offsets = np.frombuffer(buffers[1], kind)[first : first + count + 1]
    data = np.zeros(0, np.uint8) if buffers[2] is None else np.frombuffer(buffers[2], np.uint8)
    return data, offsets


def _binary(values: NDArray[np.uint8]) -> pa.Array:
    """Rows of bytes as binary values."""
    count, size = values.shape
    offsets = pa.py_buffer((np.arange(count + 1) * size).astype(np.int32))
    data = pa.py_buffer(np.ascontiguousarray(values))
    return pa.Array.from_buffers(pa.binary(), count, [None, offsets, data])


def _hex(values: NDArray[np.uint8]) -> pa.Array:
    """Rows of bytes as hexadecimal texts."""
    digits = np.stack([NIBBLES[values >> 4], NIBBLES[values & 15]], axis=-1)
    return _binary(digits.reshape(len(values), -1)).view(pa.string())


def _episodes(count: int, **columns: Any) -> pa.RecordBatch:
    """Rows of the stream of episodes; null in the columns that aren't named."""
    arrays = []
    for kind in EPISODES:
        column = columns.get(kind.name)
        if isinstance(column, pa.ChunkedArray):
            column = column.combine_chunks()
        arrays.append(pa.nulls(count, kind.type) if column is None else column.cast(kind.type))
    return pa.RecordBatch.from_arrays(arrays, schema=EPISODES)
