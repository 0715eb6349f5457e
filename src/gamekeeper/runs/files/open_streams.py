"""Streams of a run that is still open, their whole turns, and its finalizing once it was killed."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import chain, count, islice
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from gamekeeper.episodes.tables import merge
from gamekeeper.errors import RunError
from gamekeeper.runs.files.checksums import commit
from gamekeeper.runs.files.folder import inside, lock_folder, reading, system_error
from gamekeeper.runs.files.journal import read_journal
from gamekeeper.runs.files.manifest import FORMAT_VERSION, load_manifest
from gamekeeper.runs.files.parquet_tables import TableReader, write_episodes, write_table
from gamekeeper.runs.files.schema import (
    STREAMS,
    Keys,
    check_schema,
    key_arrays,
    plain_batch,
    plain_schema,
    unify,
)
from gamekeeper.runs.files.segments import SEGMENT, Cut, SegmentReader, segment_name
from gamekeeper.runs.untrusted.limits import check_memory, row_bytes

# -- Which turns of a run that was never finalized are whole: pure arithmetic over key columns
#
# The rule. Streams are written one after another, so a kill leaves each of them cut at another
# place. An episode counts from the moment its first row in `episodes` is there. Turn t of it is
# whole if
#
# 1. `timings`, where that stream exists, has a row for each turn 0..t (one for a finished turn),
# 2. `states`, where that stream exists, has a row of turn t or a later one of the episode, or has
#    rows of later episodes and none of this (its state couldn't be asked for), and
# 3. `steps` has a row of turn t or a later one of the episode (a turn's rows are never split across
#    batches, and a turn without any row carries nothing).
#
# With n whole turns, rows of turns below n are kept. Of turn n, the state is kept, and so are the
# rows in `steps` if none of them acted (`order` is null): they are the closing rows, what was given
# after the last turn. Rows of a turn n in which someone acted belong to a turn that never finished.
# (Without timings there is nothing to tell these by, and the last turn seen counts as whole.) A row
# in `episodes` that tells an episode's end counts only if the episode has as many whole turns as it
# says.

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Whole:
    """Number of whole turns of each begun episode.

    Args:
        episodes: [begun] sorted ids.
        turns: [begun] whole turns.
        acted: [begun] someone acted in the turn that follows the whole ones.
        has_timings: closing rows can be told from rows of an unfinished turn.
    """

    episodes: Keys
    turns: Keys
    acted: Mask
    has_timings: bool

    def kept(self, stream: str, episode: Keys, turn: Keys) -> Mask:
        """[rows] the rows of a stream that belong to whole turns, by the rule above."""
        place, is_begun = self.place(episode)
        whole = self.turns[place]
        kept = turn <= whole if stream == "states" else turn < whole
        if stream == "agent_steps" and self.has_timings:  # closing rows: no agent acted in them
            kept |= (turn == whole) & ~self.acted[place]
        return kept & is_begun

    def place(self, episode: Keys) -> tuple[Keys, Mask]:
        """[rows] the place of each row's episode in `episodes`, and true if it stands there."""
        place = np.searchsorted(self.episodes, episode).clip(max=len(self.episodes) - 1)
        return place, self.episodes[place] == episode

    def extent(self, episode: Keys, turn: Keys) -> Keys:
        """[begun] one more than the last turn that any row has."""
        place, is_begun = self.place(episode)
        turns = np.zeros_like(self.episodes)
        np.maximum.at(turns, place[is_begun], turn[is_begun] + 1)
        return turns

    def unbroken(self, episode: Keys, turn: Keys) -> Keys:
        """[begun] number of the turns 0, 1, 2, ... that have a row before the first without one."""
        place, is_begun = self.place(episode)
        # a turn counts if its key stands as far behind its episode's first as its number says
        keys = np.unique(place[is_begun].astype(np.int64) << 32 | turn[is_begun])
        place, turn = keys >> 32, keys & 0xFFFFFFFF
        first = np.searchsorted(place, place)
        in_run = turn == np.arange(len(keys)) - first
        return np.bincount(place[in_run], minlength=len(self.episodes)).astype(np.int64)


def whole_turns(
    begun: Keys,
    steps: tuple[Keys, Keys, Mask],
    states: tuple[Keys, Keys] | None,
    timings: tuple[Keys, Keys] | None,
) -> Whole:
    """Number of whole turns of each episode, by the rule above.

    Args:
        begun: [rows] ids in the stream of episodes, in any order.
        steps: [rows] episode, turn, and whether the agent acted.
        states: [rows] episode and turn, None where the stream doesn't exist.
        timings: the same.
    """
    # the id -1, which no row has, keeps every look-up within bounds
    episodes = np.concatenate([np.array([-1]), np.unique(begun)]).astype(np.int64)
    none = Whole(episodes, np.zeros_like(episodes), np.zeros(len(episodes), bool), False)
    turns = none.extent(steps[0], steps[1])
    if states is not None:
        reach = none.extent(*states)
        was_passed = (reach == 0) & (episodes < states[0].max(initial=-1))
        turns = np.where(was_passed, turns, np.minimum(turns, reach))
    if timings is not None:
        turns = np.minimum(turns, none.unbroken(*timings))
    place, is_begun = none.place(steps[0])
    acted = np.zeros(len(episodes), bool)
    acted[place[is_begun & steps[2] & (steps[1] == turns[place])]] = True
    return Whole(episodes, turns, acted, timings is not None)


# -- The files of an open run's streams, and which of their rows belong to whole turns


NO_JOURNAL: Final[Mapping[str, Sequence[pa.RecordBatch]]] = MappingProxyType({})


class StreamFiles:
    """The files of one stream in an open run: its Parquet file if it has one, else segments.

    `schema` and `cuts` are known once `batches` has run to its end.
    """

    def __init__(
        self,
        folder: Path,
        stream: str,
        *,
        salvage: bool,
        segments: object = None,
        journal: Mapping[str, Sequence[pa.RecordBatch]] = NO_JOURNAL,
    ) -> None:
        """Looks at nothing yet.

        Args:
            segments: the entry of that name in the run's manifest.
            journal: by stream, rows that go on where the segments end.
        """
        self.folder, self.stream, self.salvage = folder, stream, salvage
        self._journal = journal.get(stream, ())
        self._first, self._step = numbered(segments, stream)
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
        paths, last = self._segments(), -1
        is_whole = not self.cuts
        for i, path in enumerate(paths):
            reader = SegmentReader(path, self.stream, salvage=self.salvage)
            for batch in reader:
                self._widen(batch.schema)
                if batch.num_rows:
                    last = int(self._keys(batch.slice(batch.num_rows - 1))[0])
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
        if is_whole:
            yield from self._journaled(last)

    def _journaled(self, last: int) -> Iterator[pa.RecordBatch]:
        """The rows of the journal behind a turn; of `episodes` all, as they are merged anyway."""
        for batch in self._journal:
            where = str(self.folder / self.stream)
            plain = plain_batch(batch, plain_schema(batch.schema))
            check_schema(plain.schema, self.stream, where=where)
            if self.stream != "episodes":
                plain = plain.filter(pa.array(self._keys(plain) > last))
            if plain.num_rows:
                self._widen(plain.schema)
                yield plain

    def _keys(self, batch: pa.RecordBatch) -> Keys:
        episode, turn = key_arrays(batch, self.stream, where=str(self.folder / self.stream))
        return episode << 32 | turn

    def exists(self) -> bool:
        """True where the stream has a file, even one that was cut before its first batch."""
        is_table = inside(self.folder, f"{self.stream}.parquet").exists()
        return is_table or bool(self._found()) or bool(self._journal)

    def _found(self) -> dict[int, Path]:
        """The segments by their numbers."""
        found: dict[int, Path] = {}
        with reading(self.folder):
            for path in self.folder.iterdir():
                match = SEGMENT.fullmatch(path.name)
                if not match or match[1] != self.stream:
                    continue
                number = int(match[2])
                is_behind = number > self._first and not number % self._step
                if number == self._first or is_behind:
                    found[number] = inside(self.folder, path.name)
        return found

    def _segments(self) -> list[Path]:
        """The segments in order, from the first up to a gap."""
        found, paths = self._found(), []
        behind = count(self._first + self._step - self._first % self._step, self._step)
        for number in islice(chain([self._first], behind), len(found)):
            if number not in found:
                name = segment_name(self.stream, number)
                if not self.salvage:
                    raise RunError(
                        f"{name} is missing",
                        where=str(self.folder / name),
                        fix="restore the file from a copy; `gamekeeper recover` keeps the turns "
                        "before it",
                    )
                self.cuts.append(Cut(name, 0, "the segment is missing"))
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


def numbered(segments: object, stream: str) -> tuple[int, int]:
    """Number of a stream's first segment, and the step from one number to the next.

    The first segment of a run that drops episodes has an odd number, once anything was dropped;
    those behind it have the even ones that follow, and other odd ones aren't part of the run.

    Args:
        segments: the manifest's entry; other runs have none.
    Raises:
        ValueError: it is damaged.
    """
    if segments is None:
        return 0, 1
    place = segments.get(stream, {}) if isinstance(segments, dict) else None
    found = place if isinstance(place, dict) else {"first": None}
    first = found.get("first", 0)
    if type(first) is not int or first < 0 or found.get("step", 2) != 2:
        raise ValueError(f"segments.{stream} of the manifest: {place!r}"[:200])
    return first, 2


def whole_of(streams: dict[str, Iterable[pa.RecordBatch]]) -> Whole:
    """The whole turns of a run.

    Args:
        streams: by name, the batches of each stream that exists.
    """
    keys = {name: _keys(name, batches) for name, batches in streams.items()}
    nothing = np.zeros(0, np.int64)
    episode, turn, acted = keys.get("agent_steps", (nothing, nothing, nothing))
    begun = keys["episodes"][0] if "episodes" in keys else nothing
    states, timings = (keys[name][:2] if name in keys else None for name in ("states", "timings"))
    return whole_turns(begun, (episode, turn, acted.astype(bool)), states, timings)


def keep(whole: Whole, stream: str, batch: pa.RecordBatch | pa.Table) -> pa.Array:
    """[rows] which rows of a stream belong to whole turns."""
    return pa.array(whole.kept(stream, *key_arrays(batch, stream, where=stream)))


def merge_whole(table: pa.Table, whole: Whole) -> pa.Table:
    """One row an episode, as `merge` has it; a row with an end needs that many whole turns.

    Args:
        table: the rows of the stream in the order of writing.
    """
    episode, _ = key_arrays(table, "episodes", where="episodes")
    if "turns" not in table.column_names:
        return merge(table)
    at, _ = whole.place(episode)
    return merge(table, counts=table["turns"].fill_null(0).to_numpy() <= whole.turns[at])


def _keys(stream: str, batches: Iterable[pa.RecordBatch]) -> tuple[Keys, Keys, Keys]:
    """[rows] episode, turn, and 1 if the agent acted (0 where the stream has no orders)."""
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


def open_tables(
    folder: Path, manifest: Mapping[str, Any], *, salvage: bool
) -> tuple[dict[str, pa.Table], tuple[Cut, ...]]:
    """The whole turns of an open run by stream, and the places where files ended early.

    Args:
        manifest: of the run.
        salvage: damage ends a stream as a cut does, in place of raising.
    Raises:
        RunError: a file is damaged or missing.
    """
    streams, cuts = _streams(folder, manifest, salvage=salvage)
    found = {name: stream.table() for name, stream in streams.items()}
    tables = {name: table for name, table in found.items() if table is not None}
    exists = [name for name, stream in streams.items() if stream.exists()]
    whole = whole_of({name: tables[name].to_batches() if name in tables else [] for name in exists})
    for name, table in tables.items():
        is_merged = name == "episodes"
        tables[name] = (
            merge_whole(table, whole) if is_merged else table.filter(keep(whole, name, table))
        )
    return tables, (*(cut for stream in streams.values() for cut in stream.cuts), *cuts)


def _streams(
    folder: Path, manifest: Mapping[str, Any], *, salvage: bool
) -> tuple[dict[str, StreamFiles], list[Cut]]:
    """The streams of an open run, and where its journal ended early.

    The journal is read first: what is taken out of it meanwhile is in the segments then.
    """
    level, segments = str(manifest.get("level", "full")), manifest.get("segments")
    journal = read_journal(folder, level, salvage=salvage)
    with reading(folder):
        streams = {
            name: StreamFiles(
                folder, name, salvage=salvage, segments=segments, journal=journal.batches
            )
            for name in STREAMS
        }
    return streams, [journal.cut] if journal.cut else []


# -- Finalizes the whole turns of a run that its recorder left open


def finalize_recovered(
    path: str | PathLike[str], manifest: dict[str, Any], *, episodes: pa.Table | None = None
) -> None:
    """Finalizes the whole turns of a killed run; memory stays bounded by a row group.

    They are those of `open_tables` with salvage.

    Args:
        manifest: plain JSON; its `status` is "recovered" if it names none. Where files ended early,
            `cuts` is added: file, offset, why.
        episodes: the rows of episodes to be finalized in place of those found (an end "torn"
            added).
    Raises:
        RunError: it is finalized already or still being recorded, or the disk refuses.
    """
    folder = Path(path)
    with reading(folder):
        load_manifest(folder)  # says what is there, where that is no run
    lock = lock_folder(folder)
    try:
        with reading(folder):
            _finalize(folder, {"status": "recovered", **manifest}, episodes)
    finally:
        if lock >= 0:
            os.close(lock)


def _finalize(folder: Path, manifest: dict[str, Any], episodes: pa.Table | None) -> None:
    before = load_manifest(folder)
    if before["status"] != "open":
        raise RunError(
            "the run is finalized already",
            where=str(folder),
            fix="read it as it is; `gamekeeper verify` says whether it is undamaged",
        )
    streams, torn = _streams(folder, before, salvage=True)
    # A first pass reads only keys; a stream without a file has no batches and no schema after it.
    whole = whole_of(
        {name: stream.batches() for name, stream in streams.items() if stream.exists()}
    )
    cuts = (*(cut for stream in streams.values() for cut in stream.cuts), *torn)
    files = {}
    try:
        for name, stream in streams.items():
            if name == "episodes":
                table = episodes if episodes is not None else stream.table()
                if table is not None and episodes is None:
                    table = merge_whole(table, whole)
                if table is not None:
                    files[name] = write_episodes(folder, table, level=manifest.get("level"))
            elif stream.schema is not None:
                schema = plain_schema(stream.schema)
                rows = _kept(stream, schema, whole)
                files[name] = write_table(folder, name, schema, rows)
        fields = {key: value for key, value in manifest.items() if key not in ("cuts", "segments")}
        if cuts:
            fields["cuts"] = [asdict(cut) for cut in cuts]
        commit(folder, {**fields, "format_version": FORMAT_VERSION}, files)
    except BaseException as error:
        for draft, _, _ in files.values():
            draft.unlink(missing_ok=True)
        if isinstance(error, OSError) and not isinstance(error, RunError):
            raise system_error("finalizing", folder, error) from error
        raise


def _kept(stream: StreamFiles, schema: pa.Schema, whole: Whole) -> Iterator[pa.RecordBatch]:
    for batch in stream.batches():
        kept = batch.filter(keep(whole, stream.stream, batch))
        if kept.num_rows:
            yield plain_batch(kept, schema)
