"""A session of DuckDB over runs, in which only the views can be reached; and rows of queries.

DuckDB can't open files (`enable_external_access`), extensions or variables of this process, and
can't change that (`lock_configuration`): rows are given to it as Arrow's (`parquet_scan`), which it
can't write. Statements that do anything but read are refused before they run (`statement`), though
they could only change views in DuckDB's own memory.

Source: duckdb.org/docs, "Securing DuckDB".
"""

from __future__ import annotations

import csv
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

from gamekeeper.errors import DependencyError, GamekeeperError, RunError, not_installed
from gamekeeper.reporting.results_text import few
from gamekeeper.runs.files.folder import output_path, system_error
from gamekeeper.viewing.sql.evidence_places import EvidencePlaces, places_of
from gamekeeper.viewing.sql.sql_views import OWN, Maker, quoted
from gamekeeper.viewing.sql.statement import reading

BATCH: Final = 100_000
"""Rows that are in memory at a time while a file is written."""
FORMS: Final = (".parquet", ".csv")


class Rows:
    """Rows of a query, which can be read once, until the next query.

    Attributes:
        columns: names; one that comes twice has a number behind it.
        types: DuckDB's, a text for each column.
    """

    __slots__ = ("_answering", "_connection", "_cursor", "_relation", "_sql", "columns", "types")

    def __init__(
        self, connection: Any, sql: str, answering: Callable[[], AbstractContextManager[None]]
    ) -> None:
        """Checks the query, which runs when the first row is read.

        Raises:
            duckdb.Error: it can't be answered.
        """
        self._connection, self._sql, self._answering = connection, sql, answering
        self._relation: Any = connection.sql(sql)
        self._cursor: Any = None
        self.columns = unique_names([str(name) for name in self._relation.columns])
        self.types = tuple(map(str, self._relation.types))

    def take(self, most: int) -> list[tuple[Any, ...]]:
        """The next rows, at most so many.

        Raises:
            GamekeeperError: a value can't be computed as the query asks for it.
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
        """Writes the rows into a file, `.parquet` or `.csv`, and returns their number.

        An earlier file is replaced when all rows are written.

        Raises:
            GamekeeperError: the name has another ending.
            RunError: a folder has the name, the file is part of a run, or the disk refuses.
        """
        file = Path(fspath(path))
        if file.suffix not in FORMS:
            raise GamekeeperError(
                "the ending of the name isn't a known format",
                where=str(file),
                expected=" or ".join(FORMS),
                actual=file.suffix or "no ending",
                fix=f"--out {file.with_suffix('.parquet')}",
            )
        file = output_path(file)
        draft = file.with_name(f".{file.name}.part")
        try:
            count = self._parquet(draft) if file.suffix == ".parquet" else self._csv(draft)
            draft.replace(file)
            return count
        except RunError:
            raise
        except OSError as error:
            raise system_error("writing", file, error) from error
        finally:
            draft.unlink(missing_ok=True)

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
        kind = type(self._relation)  # a relation itself has its columns as attributes
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


def unique_names(names: Sequence[str]) -> tuple[str, ...]:
    """Makes names unique by a number behind those that come again."""
    found: dict[str, None] = {}
    for name in names:
        number, free = 1, name
        while free in found:
            free, number = f"{name}_{number}", number + 1
        found[free] = None
    return tuple(found)


CONFIG: Final = {
    "autoinstall_known_extensions": "false",
    "autoload_known_extensions": "false",
    "allow_persistent_secrets": "false",
    "python_enable_replacements": "false",  # a query doesn't see this process's variables
}
WORD: Final = re.compile(r"\w+")
SOURCE: Final = re.compile(
    r"(?:\b(?:from|join|pivot|unpivot|describe|summarize|show|table)\b|[,(])\s*\"?(\w+)"
)
"""Words of a query that may name a table. A view that isn't needed isn't made, as that reads every
file of every run; so a column's name (`count(*) as episodes`) shouldn't count."""
INTERRUPTED: Final = "Query interrupted"
"""Text of DuckDB's RuntimeError when Ctrl-C ended a query."""
MOST_COLUMNS: Final = 30
"""Columns of a view that a fix names."""
MOST_CHARACTERS: Final = 600
"""Characters of DuckDB's message that an error repeats."""


class Session(AbstractContextManager["Session"]):
    """An open session; closing it, or leaving its `with`, releases everything.

    For one thread. Views are made when a query first names them; an open run is read once.
    """

    def __init__(self, places: EvidencePlaces) -> None:
        """Restricts DuckDB to the evidence of `places`; use `of`.

        Raises:
            DependencyError: DuckDB isn't installed, or too old to be locked.
        """
        self._duckdb, self.places = _duckdb(), places
        self._spill = tempfile.TemporaryDirectory(prefix="gamekeeper-query-")
        self._connection = self._duckdb.connect(":memory:", config=dict(CONFIG))
        self._maker = Maker(self._connection, places)
        try:
            self._lock()
        except BaseException:
            self.close()
            raise

    @classmethod
    def of(cls, *runs: str | PathLike[str], check: bool = False) -> Session:
        """A session over the runs and evaluations that `runs` stand for; see `places_of`.

        Args:
            runs: folders, folders of folders, patterns.
            check: compare every file of a finalized run with its checksums first.
        Raises:
            RunError: a name stands for nothing, or a run is damaged.
            DependencyError: DuckDB isn't installed.
        """
        return cls(places_of(runs, check=check))

    @property
    def views(self) -> dict[str, dict[str, str]]:
        """The views, each with its columns and their types.

        Raises:
            RunError: a file is damaged.
        """
        self._make(self._maker.names())
        found: dict[str, dict[str, str]] = {}
        sql = (
            "SELECT table_name, column_name, data_type FROM duckdb_columns() "
            f"WHERE NOT internal AND NOT starts_with(table_name, {quoted(OWN)}) "
            "ORDER BY table_name, column_index"
        )
        for view, column, type_ in self._connection.execute(sql).fetchall():
            found.setdefault(view, {})[column] = type_
        return found

    def ask(self, sql: str) -> Rows:
        """Answers one statement that reads.

        The views that it names are made first. A query that names a view in another way
        (`query_table('ste' || 'ps')`) finds it at a second try, when all views are there.

        Raises:
            GamekeeperError: it does more than read, or DuckDB can't answer it.
        """
        with self._answering(sql):
            sql = reading(self._connection, sql)
            words = set(SOURCE.findall(sql.lower()))
            self._make([name for name in self._maker.names() if name in words])
            try:
                return Rows(self._connection, sql, lambda: self._answering(sql))
            except self._duckdb.CatalogException:
                self._make(self._maker.names())
                return Rows(self._connection, sql, lambda: self._answering(sql))

    def _make(self, names: Iterable[str]) -> None:
        with self._preparing("reading the runs", RunError):
            self._maker.make(names)

    def close(self) -> None:
        """Ends the session."""
        self._connection.close()
        self._spill.cleanup()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _lock(self) -> None:
        """Forbids DuckDB to open files, and to change its settings."""
        spill = quoted((Path(self._spill.name) / "spill").as_posix())
        with self._preparing("locking DuckDB", DependencyError):
            for setting in (
                f"SET temp_directory = {spill}",
                "SET enable_external_access = false",
                "SET lock_configuration = true",
            ):
                self._connection.execute(setting)

    @contextmanager
    def _preparing(self, doing: str, kind: type[GamekeeperError]) -> Iterator[None]:
        """Raises DuckDB's errors about files or settings as errors of Gamekeeper."""
        try:
            yield
        except self._duckdb.Error as error:
            raise kind(
                f"{doing} failed",
                where=f"DuckDB {self._duckdb.__version__}",
                actual=_text(error),
                fix="`gamekeeper verify` names damaged files"
                if kind is RunError
                else "pip install -U duckdb",
            ) from error

    @contextmanager
    def _answering(self, sql: str) -> Iterator[None]:
        """Raises DuckDB's errors about a query as errors of Gamekeeper."""
        try:
            yield
        except (self._duckdb.Error, RuntimeError) as error:
            while self._maker.failed:  # raised by reading a file, when DuckDB needed its rows
                raise self._maker.failed.pop() from error
            if isinstance(error, self._duckdb.InterruptException) or str(error) == INTERRUPTED:
                raise KeyboardInterrupt from error
            raise GamekeeperError(
                "the query can't be answered",
                where="the query",
                actual=_text(error),
                fix=self._fix(sql, error),
            ) from error

    def _fix(self, sql: str, error: Exception) -> str:
        """Names that the query could use: columns of the views that it names, else the views."""
        if isinstance(error, self._duckdb.PermissionException):
            return "query only the runs that the command names"
        found = self.views
        words = set(WORD.findall(sql.lower()))
        asked = [view for view in found if view in words and view != "order"]
        if not isinstance(error, self._duckdb.BinderException) or not asked:
            return f"views: {', '.join(view for view in found if view != 'order')}"
        return "columns: " + "; ".join(
            f"{view} ({few(found[view], most=MOST_COLUMNS)})" for view in asked
        )


def query(run: str | PathLike[str], *more_and_sql: str | PathLike[str], check: bool = False) -> Any:
    """Answers a query over runs with a pyarrow table.

    `query("runs/demo", "select agent, avg(return) from returns group by agent")`; before the
    query, any number of runs, each as `Session.of` takes it.

    Args:
        run: a folder, a folder of folders, or a pattern.
        more_and_sql: further runs; the last one is the query.
        check: compare every file of a finalized run with its checksums first.
    Raises:
        RunError: a name stands for nothing, or a run is damaged.
        GamekeeperError: DuckDB can't answer it.
        DependencyError: DuckDB isn't installed.
    """
    *more, sql = more_and_sql or (run,)
    with Session.of(*((run, *more) if more_and_sql else ()), check=check) as session:
        return session.ask(str(sql)).arrow()


def _duckdb() -> Any:
    try:
        import duckdb
    except ImportError as error:
        raise not_installed(error, "DuckDB", "query", "query") from error
    return duckdb


def _text(error: Exception) -> str:
    """DuckDB's message on one line, without the excerpt of the query."""
    message = str(error).partition("\n\nLINE ")[0]
    return " ".join(message.split())[:MOST_CHARACTERS]
