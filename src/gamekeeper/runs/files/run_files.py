"""Tables of a finalized run: compared with their checksums, read an episode at a time."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from gamekeeper.episodes.tables import episode_rows, kind_of
from gamekeeper.errors import RunError
from gamekeeper.runs.files.checksums import Damage, file_damage
from gamekeeper.runs.files.folder import MANIFEST
from gamekeeper.runs.files.manifest import Checksums, manifest_digest
from gamekeeper.runs.files.parquet_tables import TableReader
from gamekeeper.runs.files.schema import STREAMS

# -- The tables of a finalized run, read from Parquet an episode at a time

KEPT_GROUPS: Final = 2  # of each stream: an episode may begin in one row group and end in the next


class ParquetTables:
    """The streams of a finalized run.

    A whole stream is in memory only when it is asked for; an episode needs the row groups that hold
    it. The last row groups read are kept, because episodes are mostly read in their order.
    """

    def __init__(self, folder: Path, streams: Collection[str]) -> None:
        """Opens the Parquet files of `streams` in `folder`."""
        self._readers = {name: TableReader(folder / f"{name}.parquet", name) for name in streams}
        self._bounds: dict[str, Any] = {}
        self._kept: dict[str, dict[int, pa.Table]] = {}

    @property
    def schemas(self) -> dict[str, pa.Schema]:
        """The columns of each stream."""
        return {name: reader.schema for name, reader in self._readers.items()}

    def table(self, stream: str, *, without: Collection[str] = ()) -> pa.Table | None:
        """A whole stream, but for columns of the kinds in `without`.

        Raises:
            RunError: the file is damaged, or holds more than this machine should be asked for.
        """
        reader = self._readers.get(stream)
        return None if reader is None else reader.read(columns=_but(reader, without))

    def all_parts(self, stream: str, *, without: Collection[str] = ()) -> Iterator[pa.Table] | None:
        """A whole stream, but for columns of the kinds in `without`, a row group at a time.

        Raises:
            RunError: the file is damaged.
        """
        reader = self._readers.get(stream)
        if reader is None:
            return None
        columns = _but(reader, without)
        groups = [[number] for number in range(reader.groups)] or [[]]
        return (reader.read(columns=columns, groups=group) for group in groups)

    def episode(self, stream: str, episode: int) -> pa.Table | None:
        """The rows of one episode of a stream.

        Raises:
            RunError: the file is damaged.
        """
        reader = self._readers.get(stream)
        if reader is None:
            return None
        groups = self._groups_of(stream, reader, episode)
        tables = [self._group(stream, reader, number) for number in groups]
        return episode_rows(pa.concat_tables(tables or [reader.schema.empty_table()]), episode)

    def parts(
        self, stream: str, episode: int, *, columns: Collection[str] | None = None
    ) -> Iterator[pa.Table] | None:
        """The rows of one episode, some columns of them, a row group at a time.

        Raises:
            RunError: the file is damaged.
        """
        reader = self._readers.get(stream)
        return None if reader is None else self._parts(stream, reader, episode, columns)

    def has(self, stream: str) -> bool:
        """True if the stream was recorded."""
        return stream in self._readers

    def _parts(
        self, stream: str, reader: TableReader, episode: int, columns: Collection[str] | None
    ) -> Iterator[pa.Table]:
        groups = self._groups_of(stream, reader, episode)
        some = None if columns is None else {"episode", *columns} & set(reader.schema.names)
        if not groups:
            yield reader.schema.empty_table()
        for number in groups:
            if some is None:
                yield episode_rows(self._group(stream, reader, number), episode)
            else:
                yield episode_rows(reader.read(columns=some, groups=[number]), episode)

    def _groups_of(self, stream: str, reader: TableReader, episode: int) -> list[int]:
        """The row groups that hold rows of an episode."""
        if stream not in self._bounds:
            bounds = []
            for number in range(reader.groups):
                found = pc.min_max(reader.read(columns={"episode"}, groups=[number])["episode"])
                bounds.append((found["min"].as_py(), found["max"].as_py()))
            self._bounds[stream] = np.array(bounds, np.int64).reshape(-1, 2).T
        first, last = self._bounds[stream]  # episodes of each row group, [groups] each
        return list(np.flatnonzero((first <= episode) & (episode <= last)).tolist())

    def _group(self, stream: str, reader: TableReader, number: int) -> pa.Table:
        kept = self._kept.setdefault(stream, {})
        if number not in kept:
            while len(kept) >= KEPT_GROUPS:
                kept.pop(next(iter(kept)))
            kept[number] = reader.read(groups=[number])
        return kept[number]


def _but(reader: TableReader, without: Collection[str]) -> set[str] | None:
    """The columns that aren't of the kinds in `without`; None: all."""
    return {n for n in reader.schema.names if kind_of(n) not in without} if without else None


# -- The checksums of a finalized run's tables, compared before any of them is decoded


def check_finalized(folder: Path, manifest: dict[str, Any], checksums: Checksums) -> None:
    """Compares the manifest and every table of a finalized run with its checksums.

    Raises:
        RunError: one of them isn't as it was finalized.
    """
    damage = []
    if manifest_digest(manifest) != checksums.manifest:
        damage.append(Damage(MANIFEST, "changed", "another manifest than the one finalized"))
    for stream in STREAMS:
        damage += file_damage(folder, f"{stream}.parquet", checksums)
    for each in damage:
        raise RunError(
            f"{each.file} was changed after it was finalized",
            where=str(folder / each.file),
            expected="the bytes that were finalized",
            actual=f"{each.what}: {each.detail}".removesuffix(": "),
            fix="restore it from a copy; `gamekeeper verify` lists all damage",
        )
