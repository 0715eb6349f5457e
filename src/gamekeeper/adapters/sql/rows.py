"""What a query came to: columns with their types, rows as they are asked for, files."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import BundleError, GamekeeperError

BATCH: Final = 100_000
"""Rows that are in memory at a time while a file is written."""
FORMS: Final = (".parquet", ".csv")


class Rows:
    """The answer to a query: its columns; its rows, handed out once, until the next question.

    Attributes:
        columns: names; one that comes twice has a number behind it.
        types: DuckDB's, a text for each column.
    """

    __slots__ = ("_answering", "_connection", "_cursor", "_relation", "_sql", "columns", "types")

    def __init__(
        self, connection: Any, sql: str, answering: Callable[[], AbstractContextManager[None]]
    ) -> None:
        """Looks at the query, which runs when the first row is asked for.

        Raises:
            duckdb.Error: it can't be answered.
        """
        self._connection, self._sql, self._answering = connection, sql, answering
        self._relation: Any = connection.sql(sql)
        self._cursor: Any = None
        self.columns = apart([str(name) for name in self._relation.columns])
        self.types = tuple(map(str, self._relation.types))

    def take(self, most: int) -> list[tuple[Any, ...]]:
        """The next rows, at most so many.

        Raises:
            GamekeeperError: a value can't be made as the query asks for it.
        """
        with self._answering():
            if self._cursor is None:
                self._cursor = self._connection.execute(self._sql)
            rows: list[tuple[Any, ...]] = self._cursor.fetchmany(most)
        return rows

    def __iter__(self) -> Iterator[tuple[Any, ...]]:
        while rows := self.take(BATCH):
            yield from rows

    def arrow(self) -> Any:
        """The rows as a pyarrow table."""
        import pyarrow as pa

        with self._answering():
            reader = self._reader()
            table = pa.Table.from_batches(list(reader), reader.schema)
        return table.rename_columns(list(self.columns))

    def write(self, path: str | PathLike[str]) -> int:
        """Writes the rows into a new file, `.parquet` or `.csv`, and returns how many there were.

        Raises:
            GamekeeperError: the name ends otherwise.
            BundleError: the file is there already, or the disk refuses.
        """
        file = Path(fspath(path))
        if file.suffix not in FORMS:
            raise GamekeeperError(
                "no form is known for that name", where=str(file),
                expected=" or ".join(FORMS), seen=file.suffix or "no ending",
            )  # fmt: skip
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            with file.open("xb") as _:
                pass  # the name is ours: nothing that exists is written over
            return self._parquet(file) if file.suffix == ".parquet" else self._csv(file)
        except FileExistsError as error:
            raise BundleError(
                "something lies where the rows should go", where=str(file),
                mend="choose another name, or move it away first",
            ) from error  # fmt: skip
        except OSError as error:
            raise BundleError(f"writing failed: {error.strerror}", where=str(file)) from error

    def _parquet(self, file: Path) -> int:
        import pyarrow as pa
        import pyarrow.parquet as pq

        reader, count = self._reader(), 0
        fields = zip(reader.schema, self.columns, strict=True)
        schema = pa.schema([field.with_name(name) for field, name in fields])
        with pq.ParquetWriter(file, schema, compression="zstd") as writer, self._answering():
            for batch in reader:
                writer.write_batch(pa.RecordBatch.from_arrays(batch.columns, schema=schema))
                count += batch.num_rows
        return count

    def _reader(self) -> Any:
        """Batches of Arrow; DuckDB gave the method another name in its second version."""
        kind = type(self._relation)  # of a relation itself, columns are attributes too
        read = getattr(kind, "to_arrow_reader", None) or kind.fetch_arrow_reader
        return read(self._relation, BATCH)

    def _csv(self, file: Path) -> int:
        count = 0
        with file.open("w", newline="", encoding="utf-8") as out:
            lines = csv.writer(out)
            lines.writerow(self.columns)
            for row in self:
                lines.writerow(row)
                count += 1
        return count


def apart(names: Sequence[str]) -> tuple[str, ...]:
    """The names, one that comes again with a number behind it."""
    found: dict[str, None] = {}
    for name in names:
        number, free = 1, name
        while free in found:
            free, number = f"{name}_{number}", number + 1
        found[free] = None
    return tuple(found)
