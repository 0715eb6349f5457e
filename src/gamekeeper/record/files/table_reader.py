"""Reads a bundle's Parquet files with suspicion: sizes first, nobody's code, every page checked."""

from __future__ import annotations

import base64
import os
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from gamekeeper.record.files.folder import open_plain, reading
from gamekeeper.record.files.footer import BYTE_ARRAY, Chunk, read_footer
from gamekeeper.record.files.limits import (
    BATCH_BYTES,
    OFFSET_BYTES,
    check_growth,
    check_memory,
    row_bytes,
)
from gamekeeper.record.files.schema import EXTENSION, check_schema, plain_batch, plain_schema


class TableReader:
    """A Parquet file of a bundle, opened with suspicion.

    Raises:
        BundleError: the file is missing, damaged, or holds columns that a bundle doesn't.
    """

    __slots__ = ("_file", "_groups", "_size", "path", "schema")

    def __init__(self, path: Path, stream: str) -> None:
        self.path = path
        with open_plain(path) as file, reading(path):
            self._size = os.fstat(file.fileno()).st_size
            footer = read_footer(file, self._size)
        with reading(path):
            # Looked for before Arrow opens the file: a type that a package registered runs that
            # package's code as soon as its name is read.
            if EXTENSION in base64.b64decode(footer.arrow_schema, validate=True):
                raise ValueError("an Arrow extension type, which a bundle doesn't hold")
            self._groups = footer.groups
            self._file = pq.ParquetFile(
                pa.OSFile(str(path)),
                page_checksum_verification=True,
                read_dictionary=_suspects(self._groups),
            )
            if self._file.num_row_groups != len(self._groups):
                raise ValueError("a footer that is read in two ways")
            self.schema = plain_schema(self._file.schema_arrow)
            check_schema(self.schema, stream, where=str(path))

    @property
    def groups(self) -> int:
        """How many row groups there are."""
        return len(self._groups)

    def read(
        self, *, columns: Collection[str] | None = None, groups: Iterable[int] | None = None
    ) -> pa.Table:
        """The table, or some columns and row groups of it.

        Raises:
            BundleError: the file is damaged.
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
            BundleError: the file is damaged.
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
        table = self._file.read_row_group(number, columns=None if columns is None else schema.names)
        # Arrow takes "reward" to name "reward.delivery" too
        batches = table.select(schema.names).to_batches()
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


def _is_of(chunk: Chunk, names: list[str]) -> bool:
    """A chunk may belong to one of these columns: what is nested in one lies under its name."""
    return any(chunk.path == name or chunk.path.startswith(f"{name}.") for name in names)


def _suspects(groups: tuple[tuple[int, list[Chunk]], ...]) -> list[str]:
    """The columns whose dictionaries could stand for more than any file may ask for.

    They are read as dictionaries, so that their true size is known before they are written out.
    """
    return sorted(
        {
            chunk.path
            for _, chunks in groups
            for chunk in chunks
            if chunk.kind == BYTE_ARRAY
            and chunk.has_dictionary
            and chunk.values * chunk.size_bytes > BATCH_BYTES
        }
    )
