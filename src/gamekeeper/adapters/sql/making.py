"""Makes the views of a session: sealed bundles are read where they lie, open ones from memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.adapters.sql import views
from gamekeeper.adapters.sql.places import EPISODES, STREAMS, Place, Places
from gamekeeper.adapters.sql.tables import TABLES, Row, rows_of
from gamekeeper.adapters.sql.views import Piece, named, quoted
from gamekeeper.record.files.folder import inside

if TYPE_CHECKING:
    from gamekeeper.core.evidence import Evidence

OWN: Final = "gamekeeper_"
"""What names of tables that no user is told of begin with."""
NEEDED: Final = ("episodes", "steps")
"""Streams whose views are there even where nothing was recorded yet."""
OF_SPACES: Final = ("steps", "states")
"""Streams whose columns hang on an environment's spaces; the others' are the same for all."""
MADE_OF: Final[Mapping[str, tuple[str, ...]]] = {
    "returns": ("steps", "agents"), "endings": ("steps", "episodes"), "orders": ("steps",),
    "order": ("steps",),
}  # fmt: skip


class Maker:
    """Makes the views of one connection, each when it is first asked for."""

    def __init__(self, connection: Any, places: Places) -> None:
        """For a connection that may open the files of `places`."""
        self._connection, self._places = connection, places
        self._made: set[str] = set()
        self._evidence: dict[str, Evidence] = {}
        self._columns_of: dict[str, list[str]] = {}

    def names(self) -> tuple[str, ...]:
        """The views and tables that can be made."""
        optional = [stream for stream in STREAMS if stream in NEEDED or self._has(stream)]
        evaluated = ["evaluations"] if self.evaluated else []
        return (*TABLES, *optional, "returns", "endings", "orders", "order", *evaluated)

    def make(self, names: Iterable[str]) -> None:
        """Those of `names` that can be made are there, and what they are made of.

        Raises:
            BundleError: an open bundle or annotations are damaged.
            duckdb.Error: a Parquet file is.
        """
        for name in self.names():
            if name in names and name not in self._made:
                self.make(MADE_OF.get(name, ()))
                self._make(name)
                self._made.add(name)

    def _make(self, name: str) -> None:
        if name in TABLES:
            self._table(name, rows_of(name, self._places.bundles))
        elif name in STREAMS:
            pieces = [*self._sealed(name), *self._in_memory(name)]
            self._columns_of[name] = list(dict.fromkeys(c for each in pieces for c in each.columns))
            self._view(name, views.union_sql(pieces))
        elif name == "returns":
            self._view(name, views.returns_sql(self._columns_of["steps"]))
        elif name == "endings":
            self._view(name, views.ENDINGS)
        elif name == "evaluations":
            self._view(name, views.parquet_sql(self.evaluated, key="evaluation"))
        else:
            self._view(name, views.ORDERS)

    def _has(self, stream: str) -> bool:
        """Somebody recorded that stream."""
        places = self._places.bundles
        return any(stream in place.files for place in places) or any(
            getattr(self._loaded(place), stream) is not None for place in places if place.is_open
        )

    @property
    def files(self) -> list[str]:
        """The files that the views read, under every name by which they are read."""
        sealed = [file for place in self._places.bundles for file in place.files.values()]
        found = [*sealed, *self.evaluated]
        return list(dict.fromkeys([*found, *map(views.literal_path, found)]))

    @property
    def evaluated(self) -> list[str]:
        """The files with the episodes of evaluations."""
        found = (inside(folder, EPISODES) for folder in self._places.evaluations)
        return [file.as_posix() for file in found if file.is_file()]

    def _table(self, name: str, rows: Iterable[Row]) -> None:
        columns = TABLES[name]
        kinds = ", ".join(f"{named(column)} {type_}" for column, type_ in columns.items())
        self._connection.execute(f"CREATE TABLE {named(name)} ({kinds})")
        filled = [list(column) for column in zip(*rows, strict=True)]
        if filled:
            parts = ", ".join(f"unnest(CAST(? AS {type_}[]))" for type_ in columns.values())
            self._connection.execute(f"INSERT INTO {named(name)} SELECT {parts}", filled)

    def _view(self, name: str, sql: str) -> None:
        self._connection.execute(f"CREATE VIEW {named(name)} AS {sql}")

    def _columns(self, sql: str) -> dict[str, str]:
        """Names and types of what a statement reads."""
        found = self._connection.execute(f"DESCRIBE {sql}").fetchall()
        return {row[0]: row[1] for row in found}

    def _sealed(self, stream: str) -> list[Piece]:
        """What reads the Parquet files of a stream: one statement where their columns agree."""
        places = self._places.bundles
        files = [place.files[stream] for place in places if stream in place.files]
        if not files:
            return []
        groups = self._alike(files) if stream in OF_SPACES else [files]
        columns = [self._columns(views.parquet_sql(group[:1])) for group in groups]
        if not views.casts_of(columns):
            whole = {name: type_ for each in columns for name, type_ in each.items()}
            return [Piece(views.parquet_sql(files), whole)]
        return [
            Piece(views.parquet_sql(group), each)
            for group, each in zip(groups, columns, strict=True)
        ]

    def _alike(self, files: list[str]) -> list[list[str]]:
        """The files in groups of the same columns, as their footers tell them."""
        if len(files) == 1:
            return [files]
        listed = ", ".join(quoted(views.literal_path(file)) for file in files)
        sql = (
            "SELECT file_name, string_agg(concat_ws(' ', name, type, num_children, "
            "converted_type, logical_type), ',') "
            f"FROM parquet_schema([{listed}]) GROUP BY file_name"
        )
        signatures = dict(self._connection.execute(sql).fetchall())
        groups: dict[str, list[str]] = {}
        for file in files:
            groups.setdefault(signatures[file], []).append(file)
        return list(groups.values())

    def _in_memory(self, stream: str) -> Iterator[Piece]:
        """What reads a stream of the open bundles, up to their last whole turn."""
        places = self._places.bundles
        for number, place in enumerate(places):
            table = getattr(self._loaded(place), stream) if place.is_open else None
            if table is not None:
                yield self._registered(f"{OWN}{stream}_{number}", place.run, table)
        if stream in NEEDED and not self._has(stream):
            from gamekeeper.core.evidence import NO_STEPS
            from gamekeeper.core.press import EPISODES as NO_EPISODES

            empty = NO_STEPS if stream == "steps" else NO_EPISODES
            yield self._registered(f"{OWN}{stream}", "", empty.empty_table())

    def _registered(self, name: str, run: str, table: Any) -> Piece:
        self._connection.register(name, table)
        sql = f"SELECT {quoted(run)} AS run, * FROM {named(name)}"
        return Piece(sql, self._columns(sql))

    def _loaded(self, place: Place) -> Evidence:
        """The evidence of an open bundle, as it was when it was first asked for."""
        if place.run not in self._evidence:
            from gamekeeper.record.bundle import load

            self._evidence[place.run] = load(place.folder)
        return self._evidence[place.run]
