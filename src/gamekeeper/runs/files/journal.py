"""The journal: turns that are recorded and not encoded yet, where a kill doesn't lose them.

Making columns and digests of a few hundred rows costs 3 ms, whatever their number; writing them as
they stand on the buffer costs 0.1 ms. So a recorder writes every 40 ms what came into this file,
encodes every few seconds, and empties it then. While a run is open the file continues its segments.

The file is a row of frames: length and CRC-32 of the content, 4 bytes each, little-endian, then the
content as MessagePack, which holds data alone. The first frame says which columns the agents have.
Turns that are in the segments as well, as the process was killed before it emptied the file, are
told by their numbers.
"""

import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from itertools import chain
from pathlib import Path
from typing import Any, Final

import msgpack
import numpy as np
import pyarrow as pa

from gamekeeper.episodes.block import element_bytes
from gamekeeper.episodes.buffer import (
    DONE,
    GIVEN,
    OBSERVED,
    TURN,
    BufferedTurns,
    EpisodeEnd,
    EpisodeStart,
    LargePlace,
    Observed,
    UsualRows,
)
from gamekeeper.episodes.encoder import Encoder
from gamekeeper.episodes.layout import AgentColumns, Column, Layout, SpaceColumns, is_leaf
from gamekeeper.episodes.spaces import Codec, Leaf
from gamekeeper.errors import GamekeeperError, RunError
from gamekeeper.runs.files.folder import (
    NEW_FLAGS,
    inside,
    read_bounded,
    reading,
    system_error,
    write_all,
)
from gamekeeper.runs.files.segments import BLANK, JOURNAL, SECTOR_BYTES, Cut
from gamekeeper.runs.untrusted.limits import check_memory

HEAD: Final = struct.Struct("<II")
MOST_BYTES: Final = 1 << 30
"""Size of a journal; a recorder empties it long before."""
_OBSERVED: Final = msgpack.ExtType(1, b"")
_SURROGATES: Final = "surrogatepass"


# -- Written by the recorder's thread


class JournalWriter:
    """Appends turns that are still on the buffer; after `write` returns no kill loses them."""

    def __init__(self, folder: Path) -> None:
        """The file is made with the first turns."""
        self._path = folder / JOURNAL
        self._descriptor, self._size = -1, 0
        self._described: tuple[object, ...] | None = None

    def write(self, turns: BufferedTurns, layout: Layout, *, is_timed: bool) -> bool:
        """Hands the turns to the operating system.

        Args:
            is_timed: the run keeps the times of steps.
        Returns:
            False, and nothing is written, where something stands in them that isn't plain (a large
            observation that was put aside), or the disk refuses: columns take less room.
        """
        known = len(layout.order), layout.state
        frame: dict[str, Any] = {}
        if known != self._described:
            frame["layout"] = _layout_json(layout, is_timed)
        try:
            frame["turns"] = _turns_json(turns)
            content = msgpack.packb(frame, default=_plain, unicode_errors=_SURROGATES)
        except (TypeError, ValueError, OverflowError):
            return False
        if not self._put(HEAD.pack(len(content), zlib.crc32(content)) + content):
            return False
        self._described = known
        return True

    def clear(self) -> None:
        """Empties the file: its turns are in the segments.

        Raises:
            RunError: the disk refuses.
        """
        if self._size:
            self._cut_to(0)
        self._described = None

    def close(self) -> None:
        """Closes the file as it is."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _put(self, data: bytes) -> bool:
        """Puts all of it into the file, or nothing."""
        try:
            if self._descriptor < 0:
                self._descriptor = os.open(self._path, NEW_FLAGS, 0o666)
            write_all(self._descriptor, data)
        except OSError:
            self._cut_to(self._size)
            return False
        self._size += len(data)
        return True

    def _cut_to(self, size: int) -> None:
        try:
            if self._descriptor >= 0:
                os.ftruncate(self._descriptor, size)
                os.lseek(self._descriptor, size, os.SEEK_SET)
        except OSError as error:
            raise system_error(f"emptying {JOURNAL}", self._path, error) from error
        self._size = size


def _turns_json(turns: BufferedTurns) -> list[Any]:
    aside = LargePlace in map(type, turns.given[1::GIVEN])
    if aside or LargePlace in map(type, turns.turns[6::TURN]):
        raise TypeError("an observation that was put aside")
    usual = turns.usual
    return [
        turns.given,
        turns.done,
        turns.turns,
        [[getattr(each, name) for name in _STARTS] for each in turns.starts],
        [[getattr(each, name) for name in _ENDS] for each in turns.ends],
        [usual.agents, usual.actions, usual.rewards],
    ]


_STARTS: Final = tuple(each.name for each in fields(EpisodeStart))
_ENDS: Final = tuple(each.name for each in fields(EpisodeEnd))


def _plain(item: object) -> Any:
    """Replacement that MessagePack writes for an item that it doesn't know."""
    if item is OBSERVED:
        return _OBSERVED
    if isinstance(item, np.bool_ | np.number):
        return item.item()
    raise TypeError(type(item).__name__)


def _layout_json(layout: Layout, is_timed: bool) -> dict[str, Any]:
    columns: dict[Column, int] = {}

    def places(side: SpaceColumns | None) -> list[int] | None:
        if side is None:
            return None
        return [columns.setdefault(column, len(columns)) for column in side.columns]

    agents = [[each.name, places(each.observation), places(each.action)] for each in layout.order]
    state = places(layout.state)
    leaves = [
        [each.name, each.tag, each.leaf.path, each.leaf.kind, each.leaf.dtype, each.leaf.shape]
        for each in columns
    ]
    return {
        "columns": leaves,
        "agents": agents,
        "state": state,
        "terms": layout.terms,
        "timed": is_timed,
    }


# -- Read from a run that is open


@dataclass(frozen=True, slots=True)
class JournalRows:
    """Rows of a journal by stream, and the place where the file ended early."""

    batches: dict[str, list[pa.RecordBatch]] = field(default_factory=dict)
    cut: Cut | None = None


def read_journal(folder: Path, level: str, *, salvage: bool) -> JournalRows:
    """The rows in an open run's journal; none where there is no such file.

    Args:
        level: of the run.
        salvage: damage ends the file as a cut does, in place of raising.
    Raises:
        RunError: bytes are there and wrong.
    """
    path = inside(folder, JOURNAL)
    if not path.exists():
        return JournalRows()
    data = read_bounded(path, MOST_BYTES)
    try:
        return _read(path, data, level, salvage=salvage)
    except RunError:  # perhaps it was emptied while it was read, and written anew
        if path.exists() and data == read_bounded(path, MOST_BYTES):
            raise
        return read_journal(folder, level, salvage=salvage)


def _read(path: Path, data: bytes, level: str, *, salvage: bool) -> JournalRows:
    with reading(path):
        try:
            return _rows(data, level, salvage=salvage)
        except (GamekeeperError, MemoryError):
            raise
        except Exception as error:  # values of any other types than a recorder's
            raise ValueError(str(error) or repr(error)) from error


def _rows(data: bytes, level: str, *, salvage: bool) -> JournalRows:
    layout, is_timed, parts, cut = None, False, list[list[Any]](), None
    for offset, content, why in _frames(data):
        if content is None:
            if why == DAMAGED and not salvage:
                raise ValueError(f"{why} at byte {offset}")
            cut = Cut(JOURNAL, offset, why)
            break
        frame = msgpack.unpackb(content, ext_hook=_observed, unicode_errors=_SURROGATES)
        if "layout" in frame:
            layout, is_timed = _layout_of(frame["layout"])
        parts.append(frame["turns"])
    if layout is None:
        return JournalRows(cut=cut)
    return JournalRows(_encoded(_joined(parts, layout), layout, level, is_timed=is_timed), cut)


DAMAGED: Final = "bytes whose checksum doesn't fit"


def _frames(data: bytes) -> Iterator[tuple[int, bytes | None, str]]:
    """Offset and content of each frame; None and the reason where the file ends early."""
    offset, written = 0, len(data.rstrip(b"\0"))
    is_blank = -(-written // SECTOR_BYTES) * SECTOR_BYTES < len(data)  # as a power cut leaves it
    while offset < len(data):
        start, size, crc = offset + HEAD.size, 0, 0
        if start <= len(data):
            size, crc = HEAD.unpack_from(data, offset)
        content, why = data[start : start + size], ""
        is_whole = start + size <= len(data)
        if not (is_whole and size) or zlib.crc32(content) != crc:
            missing = f"cut: {start + size - len(data)} bytes of a frame are missing"
            why = DAMAGED if is_whole else missing
            why = BLANK if is_blank and written <= start + size else why
        yield offset, None if why else content, why
        if why:
            return
        offset = start + size


def _observed(code: int, data: bytes) -> Observed:
    if (code, data) != (_OBSERVED.code, _OBSERVED.data):
        raise ValueError(f"a value of kind {code}")
    return OBSERVED


def _layout_of(described: dict[str, Any]) -> tuple[Layout, bool]:
    columns = [
        Column(str(name), str(tag), Leaf(path, kind, dtype, tuple(shape)))
        for name, tag, path, kind, dtype, shape in described["columns"]
    ]
    if not all(is_leaf(column.leaf) for column in columns):
        raise ValueError("a column that holds no leaf of a space")
    shared: dict[tuple[int, ...], SpaceColumns] = {}

    def side(places: list[int] | None) -> SpaceColumns | None:
        if places is None:
            return None
        key = tuple(places)
        if key not in shared:
            shared[key] = SpaceColumns(_NO_CODEC, tuple(columns[place] for place in key))
        return shared[key]

    order = [
        AgentColumns(index, name, str(name), side(obs), side(action))
        for index, (name, obs, action) in enumerate(described["agents"])
    ]
    terms = tuple(str(term) for term in described["terms"])
    return Layout(terms, side(described["state"]), order=order), described["timed"] is True


_NO_CODEC: Final[Codec] = None  # type: ignore[assignment]  # rows become columns by leaves alone


def _joined(parts: Sequence[list[Any]], layout: Layout) -> BufferedTurns:
    """The turns of all frames, once their numbers of rows fit together."""
    given, done, turns, starts, ends, usual = (list(each) for each in zip(*parts, strict=True))
    given, done, turns, starts, ends = map(
        list, map(chain.from_iterable, (given, done, turns, starts, ends))
    )
    agents, actions, rewards = (
        list(chain.from_iterable(each)) for each in zip(*usual, strict=True)
    )
    # Checksums that fit don't make a frame honest: numbers are compared before rows are taken by
    # them, and sizes before columns are made.
    counts = [int(count) for count in turns[2::TURN]]
    rows, others = len(given) // GIVEN, len(agents)
    if (
        (len(given), len(done), len(turns) % TURN) != (rows * GIVEN, rows * DONE, 0)
        or not len(agents) == len(actions) == len(rewards)
        or rows != sum(count for count in counts if count > 0)
        or others != -sum(count for count in counts if count < 0)
        or not all(0 <= index < len(layout.order) for index in (*given[::GIVEN], *agents))
    ):
        raise ValueError("turns whose rows aren't all there")
    sides = [side for each in layout.order for side in (each.observation, each.action) if side]
    columns = {column for side in sides for column in side.columns}
    state = () if layout.state is None else layout.state.columns
    check_memory((rows + others) * sum(map(_cell_bytes, columns)))
    check_memory(len(counts) * sum(map(_cell_bytes, state)))
    return BufferedTurns(
        given,
        done,
        turns,
        [EpisodeStart(*each) for each in starts],
        [EpisodeEnd(*each) for each in ends],
        UsualRows(agents, actions, rewards),
    )


def _cell_bytes(column: Column) -> int:
    return 0 if column.leaf.kind in ("text", "json") else element_bytes(column)


def _encoded(
    turns: BufferedTurns, layout: Layout, level: str, *, is_timed: bool
) -> dict[str, list[pa.RecordBatch]]:
    """The turns as batches by stream.

    Their digests begin in the middle of an episode, so none stands in the rows of `episodes`.
    """
    encoder = Encoder(layout, _not_aside, level=level)
    numbers: set[Any] = {*turns.turns[::TURN], *(end.episode for end in turns.ends)}
    encoder.begin(numbers)
    found: dict[str, list[pa.RecordBatch]] = {}
    for stream, batch in encoder.encode_turns(turns).in_order():
        if stream == "timings" and not is_timed:
            continue
        found.setdefault(stream, []).append(_without_fingerprints(batch))
    return found


def _without_fingerprints(batch: pa.RecordBatch) -> pa.RecordBatch:
    for name in ("fingerprint", "info_fingerprint"):
        place = batch.schema.get_field_index(name)
        if place >= 0:
            batch = batch.set_column(place, batch.schema.field(place), pa.nulls(len(batch), "str"))
    return batch


def _not_aside(place: int, out: Any) -> None:
    raise ValueError("an observation that was put aside")
