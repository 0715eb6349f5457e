"""Makes the views of a session, in SQL over Arrow's rows of files, or of open runs in memory.

Contents of manifests and annotations are small tables beside the recorded streams.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import pyarrow as pa

from gamekeeper.runs.files.folder import inside
from gamekeeper.runs.files.notes import NOTES
from gamekeeper.runs.files.parquet_tables import TableReader
from gamekeeper.runs.files.schema import STREAMS
from gamekeeper.viewing.sql.evidence_places import EPISODES, EvidencePlaces, RunPlace
from gamekeeper.viewing.sql.parquet_scan import Scan

if TYPE_CHECKING:
    from gamekeeper.episodes.evidence import Evidence


RUN: Final = "run"
TERM: Final = "reward."
NUMBERS: Final = re.compile(r"(U?(TINY|SMALL|BIG|HUGE)?INT(EGER)?|FLOAT|DOUBLE|DECIMAL.*)")
NULL: Final = '"NULL"'
"""DuckDB's name of the type of a column that only has nulls."""
SIZED: Final = re.compile(r"\[\d+\]$")


@dataclass(frozen=True, slots=True)
class Piece:
    """Rows that one statement reads, with `run` as their first column."""

    sql: str
    columns: Mapping[str, str]


def quoted(text: str) -> str:
    """A text as a literal of SQL."""
    return "'" + text.replace("'", "''") + "'"


def named(name: str) -> str:
    """The name of a column or view as SQL."""
    return '"' + name.replace('"', '""') + '"'


def common_type(types: Iterable[str]) -> str | None:
    """The type of a column that has several types in different runs; None where DuckDB finds it.

    Integers and fractions become DOUBLE, since DuckDB would use FLOAT, which doesn't hold all
    integers; values of different kinds (numbers and lists) become text.
    """
    found = set(types) - {NULL}
    plain = {SIZED.sub("[]", type_) for type_ in found}
    if len(plain) < 2:  # Parquet's lists don't tell their length, so those of Arrow lose it
        return next(iter(plain)) if plain != found else None
    depths = {type_.count("[]") for type_ in plain}
    bare = {type_.replace("[]", "") for type_ in plain}
    if len(depths) > 1 or not all(NUMBERS.fullmatch(type_) for type_ in bare):
        return "VARCHAR"
    if "FLOAT" in bare:
        return "DOUBLE" + "[]" * depths.pop()
    return None if plain == found else "BIGINT" + "[]" * depths.pop()


def conversions_of(pieces: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """The columns that must be converted to stand in one view, with their common type."""
    types: dict[str, list[str]] = {}
    for columns in pieces:
        for name, type_ in columns.items():
            types.setdefault(name, []).append(type_)
    found = {name: common_type(each) for name, each in types.items()}
    return {name: type_ for name, type_ in found.items() if type_ is not None}


def union_sql(pieces: Sequence[Piece]) -> str:
    """The rows of all pieces, by the names of their columns."""
    conversions = conversions_of([piece.columns for piece in pieces])
    return "\nUNION ALL BY NAME\n".join(_aligned(piece, conversions) for piece in pieces)


def _aligned(piece: Piece, conversions: Mapping[str, str]) -> str:
    """A piece with its columns converted to the common types."""
    changed = ", ".join(
        f"CAST({named(name)} AS {type_}) AS {named(name)}"
        for name, type_ in conversions.items()
        if name in piece.columns
    )
    if not changed:
        return f"({piece.sql})"
    return f"(SELECT * REPLACE ({changed}) FROM ({piece.sql}))"


ACTED: Final = (
    '"order" IS NOT NULL AND raised IS NULL '
    "AND NOT coalesce(terminated, false) AND NOT coalesce(truncated, false)"
)
"""Condition of rows that are an action; None steps of ended agents aren't."""


def returns_sql(columns: Iterable[str]) -> str:
    """A row for each agent and episode: its return, and its number of actions.

    Args:
        columns: of `agent_steps`, whose reward terms are summed too; null where a run doesn't
            have the term.
    """
    terms = "".join(
        f", fsum({named(name)}) AS {named(name)}" for name in columns if name.startswith(TERM)
    )
    return f"""
SELECT run, episode, agent, role, paid.* EXCLUDE (run, episode, agent)
FROM (
    SELECT run, episode, agent, coalesce(fsum(reward), 0) AS "return",
        count(*) FILTER (WHERE {ACTED}) AS length{terms}
    FROM agent_steps GROUP BY run, episode, agent
) AS paid LEFT JOIN agents USING (run, agent)
"""


ENDINGS: Final = """
SELECT run, episode, agent,
    coalesce(
        TRY_CAST(TRY_CAST(said.endings AS JSON) AS MAP(VARCHAR, VARCHAR))[agent],
        CASE WHEN seen.terminated THEN 'terminated' WHEN seen.truncated THEN 'truncated'
            WHEN said."end" = 'ended' THEN 'left' ELSE coalesce(said."end", 'open') END
    ) AS reason,
    seen.terminated AS terminated, seen.truncated AS truncated, seen.turn AS turn
FROM (
    SELECT run, episode, agent,
        coalesce(bool_or(terminated), false) AS terminated,
        coalesce(bool_or(truncated), false) AS truncated,
        min(turn) FILTER (WHERE terminated OR truncated) AS turn
    FROM agent_steps GROUP BY run, episode, agent
) AS seen LEFT JOIN episodes AS said USING (run, episode)
"""
"""A row for each agent and episode: reason and turn of its ending, as a summary counts it."""
ORDERS: Final = (
    'SELECT run, episode, turn, agent, "order" FROM agent_steps WHERE "order" IS NOT NULL'
)
"""The order in which agents acted, in a tick or by turns."""


Row: TypeAlias = tuple[Any, ...]

_TEXT: Final = pa.string()
TABLES: Final[Mapping[str, Mapping[str, pa.DataType]]] = {
    "runs": {
        "run": _TEXT,
        "environment": _TEXT,
        "api": _TEXT,
        "status": _TEXT,
        "level": _TEXT,
        "seed": pa.int64(),
        "kwargs": _TEXT,
        "source_digest": _TEXT,
        "fingerprint": _TEXT,
    },
    "agents": {"run": _TEXT, "agent": _TEXT, "role": _TEXT},
    "labels": {
        "run": _TEXT,
        "episode": pa.int32(),
        "turn": pa.int32(),
        "agent": _TEXT,
        "label": _TEXT,
        "why": _TEXT,
        "said_by": _TEXT,
        "said_at": _TEXT,
        "proposed": pa.bool_(),
    },
}
"""Names of the tables, and their columns with Arrow's types; keywords of SQL aren't used."""


def _runs(run_folders: Iterable[RunPlace]) -> Iterator[Row]:
    for place in run_folders:
        manifest = place.manifest
        environment = _mapping(manifest.get("environment"))
        seed = manifest.get("seed")
        yield (
            place.run,
            *_texts(environment, "name", "api"),
            *_texts(manifest, "status", "level"),
            seed if type(seed) is int else None,
            json.dumps(environment.get("kwargs") or {}),
            *_texts(environment, "source_digest"),
            *_texts(manifest, "fingerprint"),
        )


def _agents(run_folders: Iterable[RunPlace]) -> Iterator[Row]:
    """Each agent's role by the recorded contract."""
    from gamekeeper.contract import Contract

    known: dict[str, Callable[[str], str | None]] = {}
    for place in run_folders:
        declared = place.manifest.get("contract")
        text = json.dumps(declared)
        if text not in known:
            known[text] = Contract.from_json(declared or {}).role_of
        for agent in place.manifest.get("agents") or ():
            yield place.run, str(agent), known[text](str(agent))


_LABEL: Final = attrgetter("episode", "turn", "agent", "label", "why", "by", "at", "proposed")


def _labels(run_folders: Iterable[RunPlace]) -> Iterator[Row]:
    from gamekeeper.diagnosis.labels import labels

    for place in run_folders:
        for each in labels(place.folder) if (place.folder / NOTES).exists() else ():
            yield place.run, *_LABEL(each)


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _texts(found: Mapping[str, Any], *names: str) -> list[str | None]:
    return [None if found.get(name) is None else str(found[name]) for name in names]


_ROWS: Final[Mapping[str, Callable[[Iterable[RunPlace]], Iterator[Row]]]] = {
    "runs": _runs,
    "agents": _agents,
    "labels": _labels,
}


OWN: Final = "gamekeeper_"
"""Start of the names of internal tables."""
NEEDED: Final = ("episodes", "agent_steps")
"""Streams whose views exist also before anything was recorded."""
MADE_OF: Final[Mapping[str, tuple[str, ...]]] = {
    "returns": ("agent_steps", "agents"),
    "endings": ("agent_steps", "episodes"),
    "orders": ("agent_steps",),
    "order": ("agent_steps",),
}


class Maker:
    """Makes the views of one connection, each when it is first needed.

    Attributes:
        failed: exceptions of reading files while DuckDB needed their rows.
    """

    def __init__(self, connection: Any, places: EvidencePlaces) -> None:
        """Begins without views, for a connection that can't open files."""
        self._connection, self._places = connection, places
        self._made: set[str] = set()
        self._evidence: dict[str, Evidence] = {}
        self._columns_of: dict[str, list[str]] = {}
        self.failed: list[BaseException] = []

    def names(self) -> tuple[str, ...]:
        """The views and tables that can be made."""
        optional = [stream for stream in STREAMS if stream in NEEDED or self._has(stream)]
        evaluated = ["evaluations"] if self.evaluated else []
        return (*TABLES, *optional, "returns", "endings", "orders", "order", *evaluated)

    def make(self, names: Iterable[str]) -> None:
        """Makes those of `names` that can be made, and the views that they need.

        Raises:
            RunError: a file is damaged.
        """
        for name in self.names():
            if name in names and name not in self._made:
                self.make(MADE_OF.get(name, ()))
                self._make(name)
                self._made.add(name)

    def _make(self, name: str) -> None:
        if name in TABLES:
            self._table(name, _ROWS[name](self._places.run_folders))
        elif name in STREAMS:
            places = self._places.run_folders
            files = [(p.run, Path(p.files[name])) for p in places if name in p.files]
            pieces = [*self._scans(name, files), *self._in_memory(name)]
            self._columns_of[name] = list(dict.fromkeys(c for each in pieces for c in each.columns))
            self._view(name, union_sql(pieces))
        elif name == "returns":
            self._view(name, returns_sql(self._columns_of["agent_steps"]))
        elif name == "endings":
            self._view(name, ENDINGS)
        elif name == "evaluations":
            files = [(file.parent.as_posix(), file) for file in self.evaluated]
            self._view(name, union_sql(list(self._scans(name, files, key="evaluation"))))
        else:
            self._view(name, ORDERS)

    def _has(self, stream: str) -> bool:
        """True if a run has that stream."""
        places = self._places.run_folders
        return any(stream in place.files for place in places) or any(
            self._loaded(place).tables.table(stream) is not None
            for place in places
            if place.is_open
        )

    @property
    def evaluated(self) -> list[Path]:
        """The files with the episodes of evaluations."""
        found = (inside(folder, EPISODES) for folder in self._places.evaluations)
        return [file for file in found if file.is_file()]

    def _table(self, name: str, rows: Iterable[Row]) -> None:
        columns = TABLES[name]
        filled = list(zip(*rows, strict=True)) or [()] * len(columns)
        arrays = map(pa.array, filled, columns.values())
        self._connection.register(OWN + name, pa.table(list(arrays), names=list(columns)))
        self._view(name, f"FROM {named(OWN + name)}")

    def _view(self, name: str, sql: str) -> None:
        self._connection.execute(f"CREATE VIEW {named(name)} AS {sql}")

    def _columns(self, sql: str) -> dict[str, str]:
        """Names and types of the columns of a statement."""
        found = self._connection.execute(f"DESCRIBE {sql}").fetchall()
        return {row[0]: row[1] for row in found}

    def _scans(
        self, stream: str, files: Iterable[tuple[str, Path]], *, key: str = RUN
    ) -> Iterator[Piece]:
        """Registers the Parquet files of a stream: one statement for those of equal columns."""
        groups: dict[pa.Schema, list[tuple[str, TableReader]]] = {}
        for folder, file in files:
            reader = TableReader(file, stream)
            reader.close()  # there may be thousands, and only some can be open at a time
            groups.setdefault(reader.schema.remove_metadata(), []).append((folder, reader))
        for number, readers in enumerate(groups.values()):
            name = f"{OWN}{stream}_files_{number}"
            self._connection.register(name, Scan(readers, key, self.failed))
            sql = f"FROM {named(name)}"
            yield Piece(sql, self._columns(sql))

    def _in_memory(self, stream: str) -> Iterator[Piece]:
        """Registers a stream of the open runs, up to their last complete turn."""
        places = self._places.run_folders
        for number, place in enumerate(places):
            table = self._loaded(place).tables.table(stream) if place.is_open else None
            if table is not None:
                yield self._registered(f"{OWN}{stream}_{number}", place.run, table)
        if stream in NEEDED and not self._has(stream):
            from gamekeeper.episodes.encoder import EPISODES as NO_EPISODES
            from gamekeeper.episodes.evidence import NO_STEPS

            empty = NO_STEPS if stream == "agent_steps" else NO_EPISODES
            yield self._registered(f"{OWN}{stream}", "", empty.empty_table())

    def _registered(self, name: str, run: str, table: Any) -> Piece:
        self._connection.register(name, table)
        sql = f"SELECT {quoted(run)} AS run, * FROM {named(name)}"
        return Piece(sql, self._columns(sql))

    def _loaded(self, place: RunPlace) -> Evidence:
        """The evidence of an open run, as it was when it was first needed."""
        if place.run not in self._evidence:
            from gamekeeper.runs.load_run import load

            self._evidence[place.run] = load(place.folder)
        return self._evidence[place.run]
