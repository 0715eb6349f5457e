"""A session of DuckDB over bundles: the views are there, and nothing else can be reached.

What DuckDB may open is settled before the first word of a query is read: the files of the bundles,
by name, and nothing besides (`allowed_paths`, `enable_external_access`), no extension, no variable
of this process, and no way to change any of that (`lock_configuration`). Statements that change
something are refused as well, though they could change no more than DuckDB's own memory.

Source: duckdb.org/docs, "Securing DuckDB".
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from os import PathLike
from pathlib import Path
from typing import Any, Final

from gamekeeper.adapters.sql.making import OWN, Maker
from gamekeeper.adapters.sql.places import Places, places_of
from gamekeeper.adapters.sql.rows import Rows
from gamekeeper.adapters.sql.views import quoted
from gamekeeper.errors import BundleError, DependencyError, GamekeeperError

CONFIG: Final = {
    "autoinstall_known_extensions": "false",
    "autoload_known_extensions": "false",
    "allow_persistent_secrets": "false",
    "python_enable_replacements": "false",  # a query doesn't see this process's variables
}
WORD: Final = re.compile(r"\w+")
READING: Final = ("SELECT", "EXPLAIN", "MULTI")
"""Statements that are answered; MULTI is a PIVOT whose columns come from the rows."""
INTERRUPTED: Final = "Query interrupted"
"""What a RuntimeError of DuckDB's says when Ctrl-C ended a query."""
MOST_COLUMNS: Final = 30
"""Columns of a view that a mend names."""
MOST_SAID: Final = 600
"""Characters of what DuckDB says that an error repeats."""


class Session(AbstractContextManager["Session"]):
    """An open session; closing it, or leaving its `with`, lets everything go.

    For one thread. Views are made when a query first names them; what an open bundle holds is read
    once.
    """

    def __init__(self, places: Places) -> None:
        """Locks away all but the files of `places`; use `of`.

        Raises:
            DependencyError: DuckDB isn't installed, or too old to be locked.
        """
        self._duckdb, self.places = _duckdb(), places
        self._spill = tempfile.TemporaryDirectory(prefix="gamekeeper-query-")
        self._connection = self._duckdb.connect(":memory:", config=dict(CONFIG))
        self._maker = Maker(self._connection, places)
        try:
            self._lock(self._maker.files)
        except BaseException:
            self.close()
            raise

    @classmethod
    def of(cls, *runs: str | PathLike[str], check: bool = False) -> Session:
        """A session over the bundles and evaluations that `runs` stand for; see `places_of`.

        Args:
            runs: folders, folders of folders, patterns.
            check: compare every file of a sealed bundle with its seal first.
        Raises:
            BundleError: there is nothing, or something is damaged.
            DependencyError: DuckDB isn't installed.
        """
        return cls(places_of(runs, check=check))

    @property
    def views(self) -> dict[str, dict[str, str]]:
        """The views, each with its columns and their types.

        Raises:
            BundleError: a file is damaged.
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
        """The answer to one statement that reads.

        Raises:
            GamekeeperError: it is no such statement, or DuckDB can't answer it.
        """
        with self._answering(sql):
            statements = self._connection.extract_statements(sql)
        kinds = [str(statement.type).rpartition(".")[2] for statement in statements]
        if len(kinds) != 1 or kinds[0] not in READING:
            raise GamekeeperError(
                "a query is one statement that reads",
                where="the query",
                expected="SELECT, FROM, WITH, VALUES, PIVOT, DESCRIBE, SUMMARIZE or EXPLAIN",
                seen=" and ".join(kinds) or "no statement",
                mend="ask one question at a time; --out writes its answer into a file",
            )
        with self._answering(sql):
            return self._asked(sql)

    def _asked(self, sql: str) -> Rows:
        """A query that DuckDB has understood, the views that it names being made first.

        One that names a view in a roundabout way (`query_table('ste' || 'ps')`) finds it the second
        time, when all are there.
        """
        words = set(WORD.findall(sql.lower()))
        self._make([name for name in self._maker.names() if name in words])
        try:
            return Rows(self._connection, sql, lambda: self._answering(sql))
        except self._duckdb.CatalogException:
            self._make(self._maker.names())
            return Rows(self._connection, sql, lambda: self._answering(sql))

    def _make(self, names: Iterable[str]) -> None:
        with self._said("reading the evidence", BundleError):
            self._maker.make(names)

    def close(self) -> None:
        """Ends the session."""
        self._connection.close()
        self._spill.cleanup()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _lock(self, files: Iterable[str]) -> None:
        """From here on only these files are opened, and no setting changes any more."""
        listed = ", ".join(map(quoted, files))
        spill = quoted((Path(self._spill.name) / "spill").as_posix())
        with self._said("locking DuckDB", DependencyError):
            for setting in (
                f"SET allowed_paths = [{listed}]",
                f"SET temp_directory = {spill}",
                "SET enable_external_access = false",
                "SET lock_configuration = true",
            ):
                self._connection.execute(setting)

    @contextmanager
    def _said(self, doing: str, kind: type[GamekeeperError]) -> Iterator[None]:
        """What DuckDB says of the evidence or of itself leaves as an error of the house."""
        try:
            yield
        except self._duckdb.Error as error:
            version = self._duckdb.__version__
            raise kind(
                f"{doing} failed", where=f"DuckDB {version}", seen=_text(error),
                mend="`gamekeeper verify` says which file is damaged"
                if kind is BundleError else "pip install -U duckdb",
            ) from error  # fmt: skip

    @contextmanager
    def _answering(self, sql: str) -> Iterator[None]:
        """What DuckDB says of a query leaves as an error of the house."""
        try:
            yield
        except (self._duckdb.Error, RuntimeError) as error:
            if isinstance(error, self._duckdb.InterruptException) or str(error) == INTERRUPTED:
                raise KeyboardInterrupt from error
            raise GamekeeperError(
                "the query can't be answered", where="the query", seen=_text(error),
                mend=self._mend(sql, error),
            ) from error  # fmt: skip

    def _mend(self, sql: str, error: Exception) -> str:
        """What there is to ask for: the columns of the views that are named, else the views."""
        if isinstance(error, self._duckdb.PermissionException):
            return "a query reads the runs that the command names, and nothing else"
        found = self.views
        words = set(WORD.findall(sql.lower()))
        asked = [view for view in found if view in words and view != "order"]
        if not isinstance(error, self._duckdb.BinderException) or not asked:
            return f"views: {', '.join(view for view in found if view != 'order')}"
        return "columns: " + "; ".join(f"{view} ({_few(list(found[view]))})" for view in asked)


def query(run: str | PathLike[str], *more_and_sql: str | PathLike[str], check: bool = False) -> Any:
    """The answer to a query over bundles, as a pyarrow table.

    `query("runs/demo", "select agent, avg(return) from returns group by agent")`; before the
    query, as many runs as wanted, each as `Session.of` takes it.

    Args:
        run: a folder, a folder of folders, or a pattern.
        more_and_sql: further runs; the last one is the query.
        check: compare every file of a sealed bundle with its seal first.
    Raises:
        BundleError: there is nothing, or something is damaged.
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
        raise DependencyError(
            "DuckDB isn't installed", where="query", seen=str(error),
            mend="pip install 'gamekeeper[query]'",
        ) from error  # fmt: skip
    return duckdb


def _text(error: Exception) -> str:
    """What DuckDB says, on one line, without the excerpt of the query."""
    said = str(error).partition("\n\nLINE ")[0]
    return " ".join(said.split())[:MOST_SAID]


def _few(names: list[str]) -> str:
    more = len(names) - MOST_COLUMNS
    return ", ".join(names[:MOST_COLUMNS]) + (f" and {more} more" if more > 0 else "")
