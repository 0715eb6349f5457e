"""Reads a bundle's Parquet files with suspicion: sizes first, nobody's code, every page checked."""

from __future__ import annotations

import base64
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from gamekeeper.record.folder import open_plain, reading
from gamekeeper.record.limits import OFFSET_BYTES, SMALL_BYTES, check_growth, row_bytes
from gamekeeper.record.schema import EXTENSION, check_schema, plain_batch, plain_schema


class TableReader:
    """A Parquet file of a bundle, opened with suspicion.

    Raises:
        BundleError: the file is missing, damaged, or holds columns that a bundle doesn't.
    """

    __slots__ = ("_file", "_grown", "_size", "path", "schema")

    def __init__(self, path: Path, stream: str) -> None:
        self.path, self._grown = path, 0
        with open_plain(path) as file:
            self._size = os.fstat(file.fileno()).st_size
        with reading(path):
            source = pa.OSFile(str(path))
            metadata = pq.read_metadata(source)
            # Looked for before Arrow decodes the schema: a type that a package registered runs that
            # package's code as soon as its name is read.
            stored = (metadata.metadata or {}).get(b"ARROW:schema", b"")
            if EXTENSION in base64.b64decode(stored):
                raise ValueError("an Arrow extension type, which a bundle doesn't hold")
            self._file = pq.ParquetFile(
                source,
                metadata=metadata,
                page_checksum_verification=True,
                read_dictionary=_suspects(metadata),
            )
            self.schema = plain_schema(self._file.schema_arrow)
            check_schema(self.schema, stream, where=str(path))

    def read(self) -> pa.Table:
        """The whole table.

        Raises:
            BundleError: the file is damaged.
        """
        return pa.Table.from_batches(self.batches(), schema=self.schema)

    def batches(self) -> Iterator[pa.RecordBatch]:
        """The table in batches, at most a row group of it in memory.

        Raises:
            BundleError: the file is damaged.
        """
        for number in range(self._file.num_row_groups):
            with reading(self.path):
                batches = self._group(number)
            yield from batches

    def _group(self, number: int) -> list[pa.RecordBatch]:
        group = self._file.metadata.row_group(number)
        rows = group.num_rows * sum(row_bytes(field.type) for field in self.schema)
        chunks = [group.column(i) for i in range(group.num_columns)]
        values = OFFSET_BYTES * sum(chunk.num_values for chunk in chunks)
        self._grow(rows + values + sum(chunk.total_uncompressed_size for chunk in chunks))
        batches = self._file.read_row_group(number).to_batches()
        for batch in batches:
            for column in batch.columns:
                if pa.types.is_dictionary(column.type):
                    lengths = pc.binary_length(column.dictionary)
                    self._grow(pc.sum(lengths.take(column.indices)).as_py() or 0)
        plain = [plain_batch(batch, self.schema) for batch in batches]
        for batch in plain:
            batch.validate(full=True)
        return plain

    def _grow(self, size: int) -> None:
        self._grown += size
        check_growth(self._grown, self._size)


def _suspects(metadata: Any) -> list[str]:
    """The columns whose dictionaries could stand for more than any file may ask for.

    They are read as dictionaries, so that their true size is known before they are written out.
    """
    found = set()
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        for i in range(group.num_columns):
            chunk = group.column(i)
            is_large = chunk.num_values * chunk.total_uncompressed_size > SMALL_BYTES
            if chunk.physical_type == "BYTE_ARRAY" and chunk.has_dictionary_page and is_large:
                found.add(chunk.path_in_schema)
    return sorted(found)
