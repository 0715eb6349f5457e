"""Hands rows of Parquet files to DuckDB as a dataset of Arrow's, which it can read and not write.

DuckDB never learns a file's name. Each file is read by `TableReader`, which looks at sizes and
types first: the columns that a query needs alone, a row group at a time. A few row groups ahead are
read by threads, since Arrow decodes without Python's lock; their order stays.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final

import pyarrow as pa
import pyarrow.dataset as ds
from pyarrow.fs import LocalFileSystem

from gamekeeper.runs.files.parquet_tables import TableReader
from gamekeeper.runs.files.schema import plain_batch

MOST_THREADS: Final = 4
"""Threads that read ahead: so many row groups and one more are in memory, of a few MB each."""


class Scan(ds.FileSystemDataset):
    """The rows of files of one schema, one file after another, with their folder in a column.

    DuckDB asks a dataset for a scanner, and that for its batches; `scanner` gives it one of ours.
    The dataset's own file holds no table and can't be read: a DuckDB that asks in another way gets
    an error.
    """

    def __init__(
        self, readers: Sequence[tuple[str, TableReader]], key: str, failed: list[BaseException]
    ) -> None:
        """Prepares a dataset of files.

        Args:
            readers: for each file, its folder as the column `key` has it, and its reader.
            key: the first column's name.
            failed: is filled with exceptions of reading; DuckDB only passes on their text.
        """
        columns = readers[0][1].schema.remove_metadata()
        schema = pa.schema([pa.field(key, pa.string()), *columns])
        files, form = LocalFileSystem(), ds.ParquetFileFormat()
        super().__init__([form.make_fragment(os.devnull, files)], schema, form, files)
        self._readers, self._key, self._failed = readers, key, failed

    def scanner(self, **options: Any) -> ScanBatches:
        """Source of the batches that DuckDB takes: `columns` of the rows that fit a `filter`."""
        columns = options.get("columns") or self.schema.names
        schema = pa.schema([self.schema.field(name) for name in columns])
        batches = self._batches(schema, options.get("filter"))
        return ScanBatches(pa.RecordBatchReader.from_batches(schema, batches))

    def _batches(self, schema: pa.Schema, fitting: Any) -> Iterator[pa.RecordBatch]:
        # A filter may need columns that aren't returned; its text names them all.
        text = "" if fitting is None else str(fitting)
        names = [name for name in self.schema.names if name in schema.names or name in text]
        whole = pa.schema([self.schema.field(name) for name in names])
        # At least one column of the file is read, for the number of rows.
        columns = [name for name in names if name != self._key] or self.schema.names[1:2]

        def read(folder: str, reader: TableReader, group: int) -> list[pa.RecordBatch]:
            found = []
            with reader.reopened() as opened:
                for batch in opened.batches(columns=columns, groups=[group]):
                    keys = pa.repeat(folder, batch.num_rows)
                    rows = plain_batch(batch.append_column(self._key, keys), whole)
                    rows = rows if fitting is None else rows.filter(fitting)
                    found.append(rows.select(schema.names))
            return found

        threads = min(MOST_THREADS, os.cpu_count() or 1)
        pool = ThreadPoolExecutor(threads, thread_name_prefix="gamekeeper-scan")
        ahead: deque[Future[list[pa.RecordBatch]]] = deque()
        try:
            for folder, reader in self._readers:
                for group in range(reader.groups):
                    ahead.append(pool.submit(read, folder, reader, group))
                    if len(ahead) > threads:
                        yield from ahead.popleft().result()
            while ahead:
                yield from ahead.popleft().result()
        except GeneratorExit:  # DuckDB has enough rows
            raise
        except BaseException as error:  # also Ctrl-C, which DuckDB would make an error of its own
            self._failed.append(error)
            raise
        finally:
            pool.shutdown(cancel_futures=True)


@dataclass(frozen=True, slots=True)
class ScanBatches:
    """Batches under the method that DuckDB calls."""

    reader: pa.RecordBatchReader

    def to_reader(self) -> pa.RecordBatchReader:
        """The batches, as DuckDB asks for them."""
        return self.reader
