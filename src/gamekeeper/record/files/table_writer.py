"""Writes a bundle's Parquet files in bounded memory, encoded for what their columns hold."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from gamekeeper.record.files.folder import open_plain, system_error
from gamekeeper.record.files.schema import plain_batch

GROUP_ROWS: Final = 1 << 17
GROUP_BYTES: Final = 32 << 20
HASH_BYTES: Final = 1 << 20
LEVEL: Final = 3  # zstd; 1 wasn't faster, 6 three times slower for 4 % less
# Whole numbers that mostly rise by one: differences take next to nothing.
COUNTERS: Final = ("episode", "turn", "order", "wall_ns")


class TableWriter:
    """Writes one stream's Parquet file row group by row group, hashing it as it grows.

    Args:
        path: the file, replaced if it exists.
        schema: of every batch, or of a superset of its columns.
    """

    __slots__ = ("_bytes", "_digest", "_hashed", "_rows", "_waiting", "_writer", "path", "schema")

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self.path, self.schema = path, schema
        self._waiting: list[pa.RecordBatch] = []
        self._rows = self._bytes = self._hashed = 0
        self._digest = hashlib.blake2b(digest_size=32)
        try:
            path.unlink(missing_ok=True)
            self._writer = pq.ParquetWriter(path, schema, **encodings(schema))
        except OSError as error:
            raise system_error(f"starting {path.name}", path, error) from error

    def add(self, batch: pa.RecordBatch) -> None:
        """The batch's rows come next; a row group is written when enough are waiting.

        Raises:
            BundleError: the disk refuses.
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
            BundleError: the disk refuses.
        """
        self._flush()
        try:
            self._writer.close()
            self._hash()
        except OSError as error:
            raise system_error(f"writing {self.path.name}", self.path, error) from error
        return self._hashed, self._digest.hexdigest()

    def discard(self) -> None:
        """The file is gone."""
        with suppress(OSError, pa.ArrowException):  # no footer fits on a full disk, and none must
            self._writer.close()
        self._waiting.clear()
        self.path.unlink(missing_ok=True)

    def _flush(self) -> None:
        if not self._waiting:
            return
        table = pa.Table.from_batches(self._waiting, schema=self.schema)
        self._waiting, self._rows, self._bytes = [], 0, 0
        try:
            self._writer.write_table(table, row_group_size=max(1, table.num_rows))
            self._hash()
        except OSError as error:
            raise system_error(f"writing {self.path.name}", self.path, error) from error

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
        BundleError: the disk refuses.
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


def encodings(schema: pa.Schema) -> dict[str, Any]:
    """The options of a Parquet writer that suit the columns.

    Floats, also inside lists, are split by byte (their exponents then compress), counters stand as
    differences, other integers and text get dictionaries (few agents, few actions), bytes stay
    plain.
    """
    sink = pa.BufferOutputStream()
    pq.write_table(schema.empty_table(), sink)
    leaves = pq.read_metadata(pa.BufferReader(sink.getvalue())).schema
    chosen, dictionary = {}, []
    for i in range(len(leaves)):
        leaf = leaves.column(i)
        is_half = leaf.logical_type.type == "FLOAT16"
        if leaf.path in COUNTERS and leaf.physical_type in ("INT32", "INT64"):
            chosen[leaf.path] = "DELTA_BINARY_PACKED"
        elif leaf.physical_type in ("FLOAT", "DOUBLE") or is_half:
            chosen[leaf.path] = "BYTE_STREAM_SPLIT"
        elif leaf.physical_type in ("INT32", "INT64") or leaf.logical_type.type == "STRING":
            dictionary.append(leaf.path)
    return {
        "compression": "zstd",
        "compression_level": LEVEL,
        "use_dictionary": dictionary,
        "column_encoding": chosen,
        "write_page_checksum": True,
    }
