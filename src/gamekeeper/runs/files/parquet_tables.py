"""Parquet files of a run, written in bounded memory and read with suspicion."""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from copy import copy
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from gamekeeper.runs.files.folder import open_plain, reading, system_error
from gamekeeper.runs.files.schema import (
    ABSENT,
    EXTENSION,
    check_schema,
    plain_batch,
    plain_schema,
    with_absent,
)
from gamekeeper.runs.untrusted.limits import (
    BATCH_BYTES,
    OFFSET_BYTES,
    check_growth,
    check_memory,
    row_bytes,
)
from gamekeeper.runs.untrusted.parquet_footer import BYTE_ARRAY, ColumnChunk, read_footer

# -- Writes a run's Parquet files in bounded memory, encoded for what their columns hold

GROUP_ROWS: Final = 1 << 17
GROUP_BYTES: Final = 32 << 20
HASH_BYTES: Final = 1 << 20
LEVEL: Final = 3  # zstd; 1 wasn't faster, 6 three times slower for 4 % less
KEPT_LEVEL: Final = 9  # at level actions, most columns of which repeat: 8 % less, and little slower
# Whole numbers that mostly rise by one: differences take next to nothing.
COUNTERS: Final = ("episode", "order", "wall_ns", "seed", "since")
KEYS: Final = ["episode", "turn"]  # nobody looks for rows by the least and most of other columns
KEPT_METADATA: Final = {"level": "actions"}  # of a file that leaves columns out
PRINTS: Final = ("fingerprint", "info_fingerprint")
SAMPLE_ROWS: Final = 4096
FEW: Final = 16  # rows of a sample for each distinct value, above which a dictionary pays


class TableWriter:
    """Writes one stream's Parquet file row group by row group, hashing it as it grows.

    Args:
        path: the file, replaced if it exists.
        schema: of every batch, or of a superset of its columns.
    """

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self.path, self.schema = path, _stored(schema)
        self._waiting: list[pa.RecordBatch] = []
        self._rows = self._bytes = self._hashed = 0
        self._digest = hashlib.blake2b(digest_size=32)
        self._writer: pq.ParquetWriter | None = None  # made once rows tell what suits them
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise system_error(f"starting {path.name}", path, error) from error

    def widen(self, schema: pa.Schema) -> bool:
        """Takes a schema that has all columns of the one before; False if rows were written.

        Then the file lacks a column, and has to be written anew.
        """
        schema = _stored(schema)
        if schema.equals(self.schema):
            return True
        self.schema = schema
        if self._writer is not None:
            return False
        self._waiting = [plain_batch(batch, schema) for batch in self._waiting]
        return True

    def add(self, batch: pa.RecordBatch) -> None:
        """The batch's rows come next; a row group is written when enough are waiting.

        Raises:
            RunError: the disk refuses.
        """
        batch = plain_batch(batch, self.schema)
        row_bytes = max(1, batch.nbytes // max(1, batch.num_rows))
        stride = max(1, min(GROUP_ROWS, GROUP_BYTES // row_bytes))
        for start in range(0, batch.num_rows, stride):
            part = batch.slice(start, stride)
            self._waiting.append(part)
            self._rows += part.num_rows
            self._bytes += part.nbytes
            if self._rows >= GROUP_ROWS or self._bytes >= GROUP_BYTES:
                self._flush()

    def finish(self) -> tuple[int, str]:
        """The file is whole, and not synced yet; its size in bytes and its digest.

        Raises:
            RunError: the disk refuses.
        """
        self._flush()
        try:
            self._started(self.schema.empty_table()).close()
            self._hash()
        except OSError as error:
            raise system_error(f"writing {self.path.name}", self.path, error) from error
        return self._hashed, self._digest.hexdigest()

    def discard(self) -> None:
        """The file is gone."""
        if self._writer is not None:
            # no footer fits on a full disk, and none must
            with suppress(OSError, pa.ArrowException):
                self._writer.close()
        self._waiting.clear()
        self.path.unlink(missing_ok=True)

    def _flush(self) -> None:
        if not self._waiting:
            return
        table = pa.Table.from_batches(self._waiting, schema=self.schema)
        self._waiting, self._rows, self._bytes = [], 0, 0
        try:
            writer = self._started(table)
            writer.write_table(table, row_group_size=max(1, table.num_rows))
            self._hash()
        except OSError as error:
            raise system_error(f"writing {self.path.name}", self.path, error) from error

    def _started(self, table: pa.Table) -> pq.ParquetWriter:
        """The writer, with the encodings that suit its first rows."""
        if self._writer is None:
            self._writer = pq.ParquetWriter(self.path, self.schema, **encodings(table))
        return self._writer

    def _hash(self) -> None:
        # What was just written is read back from the page cache, so that closing a long run needn't
        # hash the whole file.
        with open_plain(self.path) as file:
            file.seek(self._hashed)
            while data := file.read(HASH_BYTES):
                self._digest.update(data)
                self._hashed += len(data)


def write_table(
    folder: Path, stream: str, schema: pa.Schema, batches: Iterable[pa.RecordBatch]
) -> tuple[Path, int, str]:
    """The draft of a stream's Parquet file that holds these batches, its size and its digest.

    Raises:
        RunError: the disk refuses.
    """
    writer = TableWriter(folder / f"{stream}.parquet.tmp", schema)
    try:
        for batch in batches:
            writer.add(batch)
        size, digest = writer.finish()
    except BaseException:
        writer.discard()
        raise
    return writer.path, size, digest


def write_episodes(folder: Path, episodes: pa.Table, *, level: object) -> tuple[Path, int, str]:
    """The draft of `episodes.parquet`, its size and its digest.

    At level `actions` columns without a value are left out, and so are the fingerprints, which
    follow from the rows: they were half of such a run.

    Raises:
        RunError: the disk refuses.
    """
    if level == "actions":
        absent = {n for n in ABSENT["episodes"] if episodes[n].null_count == len(episodes)}
        episodes = episodes.drop_columns(list(absent.union(PRINTS)))
        episodes = episodes.replace_schema_metadata(KEPT_METADATA)
    return write_table(folder, "episodes", episodes.schema, episodes.to_batches())


def _stored(schema: pa.Schema) -> pa.Schema:
    """The columns of a stream that its file has: of level `actions`, those that it keeps."""
    if "observed" not in schema.names:
        return schema
    fields = [field for field in schema if field.name not in ABSENT["agent_steps"]]
    return pa.schema(fields, KEPT_METADATA)


def encodings(table: pa.Table) -> dict[str, Any]:
    """The options of a Parquet writer that suit the columns, by the first rows of them.

    Floats, also inside lists, are split by byte (their exponents then compress), but for columns of
    numbers that come again: those that all agents are paid alike stand plain, where zstd finds
    them, and few different ones get a dictionary. Counters stand as differences. Turns, which rise
    by one after as many rows as there are agents, are split by byte: one that no episode exceeds is
    zero throughout. Other integers and text get dictionaries (few agents, few actions), and so do
    digests that come again; other bytes stay plain.
    """
    sink = pa.BufferOutputStream()
    pq.write_table(table.schema.empty_table(), sink)
    leaves = pq.read_metadata(pa.BufferReader(sink.getvalue())).schema
    chosen, dictionary = {}, []
    for i in range(len(leaves)):
        leaf = leaves.column(i)
        is_half = leaf.logical_type.type == "FLOAT16"
        if leaf.path in COUNTERS and leaf.physical_type in ("INT32", "INT64"):
            chosen[leaf.path] = "DELTA_BINARY_PACKED"
        elif leaf.path == "turn":
            chosen[leaf.path] = "BYTE_STREAM_SPLIT"
        elif leaf.path == "digest":
            if _rows_per_value(table, leaf.path, sample=GROUP_ROWS) >= 2:
                dictionary.append(leaf.path)
            else:
                chosen[leaf.path] = "DELTA_LENGTH_BYTE_ARRAY"
        elif leaf.physical_type in ("FLOAT", "DOUBLE") or is_half:
            rows_per_value = 0.0 if is_half else _rows_per_value(table, leaf.path)
            if rows_per_value >= FEW:
                dictionary.append(leaf.path)
            else:
                chosen[leaf.path] = "PLAIN" if rows_per_value >= 2 else "BYTE_STREAM_SPLIT"
        elif leaf.physical_type in ("INT32", "INT64") or leaf.logical_type.type == "STRING":
            dictionary.append(leaf.path)
    return {
        "compression": "zstd",
        "compression_level": KEPT_LEVEL if "observed" in table.schema.names else LEVEL,
        "use_dictionary": dictionary,
        "column_encoding": chosen,
        "write_page_checksum": True,
        "write_statistics": KEYS,
    }


def _rows_per_value(table: pa.Table, name: str, *, sample: int = SAMPLE_ROWS) -> float:
    """Mean number of rows for each distinct value, in a column's first rows; 0 inside a list."""
    if name not in table.schema.names:
        return 0.0
    values = table[name].slice(0, sample).drop_null()
    distinct: int = pc.count_distinct(values).as_py()
    return len(values) / max(1, distinct)


# -- Reads a run's Parquet files with suspicion: sizes first, no foreign code, every page checked


class TableReader:
    """A Parquet file of a run, opened with suspicion.

    Raises:
        RunError: the file is missing, damaged, or holds columns that a run doesn't.
    """

    def __init__(self, path: Path, stream: str) -> None:
        self.path = path
        with open_plain(path) as file, reading(path):
            self._size = os.fstat(file.fileno()).st_size
            footer = read_footer(file, self._size)
        with reading(path):
            # Looked for before Arrow opens the file: a type that a package registered runs that
            # package's code as soon as its name is read.
            if EXTENSION in base64.b64decode(footer.arrow_schema, validate=True):
                raise ValueError("an Arrow extension type, which a run doesn't hold")
            self._groups = footer.groups
            # Columns whose dictionaries could stand for more than any file may ask for are read as
            # dictionaries, so that their true size is known before they are written out.
            every = [
                chunk for _, chunks in self._groups for chunk in chunks if chunk.kind == BYTE_ARRAY
            ]
            self._suspects = sorted(
                {
                    chunk.path
                    for chunk in every
                    if chunk.has_dictionary and chunk.values * chunk.size_bytes > BATCH_BYTES
                }
            )
            self._file = self._opened()
            if self._file.num_row_groups != len(self._groups):
                raise ValueError("a footer that is read in two ways")
            stored = self._file.schema_arrow
            check_schema(plain_schema(stored), stream, where=str(path))
            self.schema = plain_schema(with_absent(stored, stream))
            self._stored = frozenset(stored.names)

    @property
    def groups(self) -> int:
        """Number of row groups."""
        return len(self._groups)

    def close(self) -> None:
        """Lets the file go; `reopened` reads it again."""
        self._file.close(force=True)

    @contextmanager
    def reopened(self) -> Iterator[TableReader]:
        """A reader of the file as it was looked at, with a handle of its own.

        Raises:
            RunError: the file is missing or unreadable.
        """
        again = copy(self)
        with reading(self.path):
            again._file = self._opened(self._file.metadata)
        try:
            yield again
        finally:
            again.close()

    def _opened(self, metadata: Any = None) -> pq.ParquetFile:
        return pq.ParquetFile(
            pa.OSFile(str(self.path)),
            metadata=metadata,
            page_checksum_verification=True,
            read_dictionary=self._suspects,
        )

    def read(
        self, *, columns: Collection[str] | None = None, groups: Iterable[int] | None = None
    ) -> pa.Table:
        """The table, or some columns and row groups of it.

        Raises:
            RunError: the file is damaged.
        """
        batches, size = [], 0
        for batch in self.batches(columns=columns, groups=groups):
            batches.append(batch)
            size += batch.nbytes
            with reading(self.path):
                check_memory(size)
        return pa.Table.from_batches(batches, schema=self._some(columns))

    def batches(
        self, *, columns: Collection[str] | None = None, groups: Iterable[int] | None = None
    ) -> Iterator[pa.RecordBatch]:
        """The table in batches, at most a row group of it in memory.

        Raises:
            RunError: the file is damaged.
        """
        for number in range(len(self._groups)) if groups is None else groups:
            with reading(self.path):
                batches = self._group(number, columns)
            yield from batches

    def _some(self, columns: Collection[str] | None) -> pa.Schema:
        if columns is None:
            return self.schema
        return pa.schema([field for field in self.schema if field.name in columns])

    def _group(self, number: int, columns: Collection[str] | None) -> list[pa.RecordBatch]:
        schema = self._some(columns)
        rows, chunks = self._groups[number]
        wanted = [chunk for chunk in chunks if _is_of(chunk, schema.names)]
        size = rows * sum(row_bytes(field.type) for field in schema)
        size += sum(OFFSET_BYTES * chunk.values + chunk.size_bytes for chunk in wanted)
        check_growth(size, self._size)
        names = [n for n in schema.names if n in self._stored] or self.schema.names[:1]
        table = self._file.read_row_group(number, columns=None if columns is None else names)
        # Arrow takes "reward" to name "reward.delivery" too
        batches = table.select(names).to_batches()
        for column in table.itercolumns():
            if pa.types.is_dictionary(column.type):
                check_growth(size + sum(_text_bytes(part) for part in column.chunks), self._size)
        plain = [plain_batch(batch, schema) for batch in batches]
        for batch in plain:
            batch.validate(full=True)
        return plain


def _text_bytes(column: pa.DictionaryArray) -> int:
    """Bytes of a column's texts once each row has its own."""
    return pc.sum(pc.binary_length(column.dictionary).take(column.indices)).as_py() or 0


def _is_of(chunk: ColumnChunk, names: list[str]) -> bool:
    """A chunk may belong to one of these columns: what is nested in one lies under its name."""
    return any(chunk.path == name or chunk.path.startswith(f"{name}.") for name in names)
