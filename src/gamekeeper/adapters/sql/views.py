"""The views of a query as SQL text: what they read, and what they add up."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

RUN: Final = "run"
FILE: Final = "gamekeeper_file"
"""The column in which DuckDB says which file a row is from; no view shows it."""
TERM: Final = "reward."
NUMBERS: Final = re.compile(r"(U?(TINY|SMALL|BIG|HUGE)?INT(EGER)?|FLOAT|DOUBLE|DECIMAL.*)")
NULL: Final = '"NULL"'
"""As DuckDB calls the type of a column that holds nothing but nulls."""
SIZED: Final = re.compile(r"\[\d+\]$")


@dataclass(frozen=True, slots=True)
class Piece:
    """Rows that one statement reads, with `run` as their first column.

    Attributes:
        sql: the statement.
        columns: names and DuckDB's types.
    """

    sql: str
    columns: Mapping[str, str]


def quoted(text: str) -> str:
    """A text as SQL."""
    return "'" + text.replace("'", "''") + "'"


def named(name: str) -> str:
    """The name of a column or view as SQL."""
    return '"' + name.replace('"', '""') + '"'


def literal_path(path: str) -> str:
    """A path as DuckDB's patterns have it, standing for itself alone."""
    return re.sub(r"([*?\[])", r"[\1]", path)


def parquet_sql(files: Sequence[str], *, key: str = RUN) -> str:
    """Reads Parquet files by the names of their columns; what a file lacks is null.

    Args:
        files: in several folders, files of one name.
        key: the column that tells the folder.
    """
    listed = ", ".join(quoted(literal_path(file)) for file in files)
    name = len(files[0].rpartition("/")[2]) + 1
    return (
        f"SELECT left({FILE}, length({FILE}) - {name}) AS {key}, * EXCLUDE ({FILE}) "
        f"FROM read_parquet([{listed}], union_by_name = true, filename = {quoted(FILE)}, "
        "hive_partitioning = false)"
    )


def common_type(types: Iterable[str]) -> str | None:
    """The type that a column of several types has in a view of all; None where DuckDB finds it.

    Whole numbers and fractions come together as DOUBLE, since DuckDB would take FLOAT for whole
    numbers that it doesn't hold; what is of several kinds (a number here, a list there) as text.
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


def casts_of(pieces: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """The columns that don't go together as they are, and the type that they are brought to."""
    types: dict[str, list[str]] = {}
    for columns in pieces:
        for name, type_ in columns.items():
            types.setdefault(name, []).append(type_)
    found = {name: common_type(each) for name, each in types.items()}
    return {name: type_ for name, type_ in found.items() if type_ is not None}


def union_sql(pieces: Sequence[Piece]) -> str:
    """All pieces one below the other, by the names of their columns."""
    casts = casts_of([piece.columns for piece in pieces])
    return "\nUNION ALL BY NAME\n".join(_aligned(piece, casts) for piece in pieces)


def _aligned(piece: Piece, casts: Mapping[str, str]) -> str:
    """A piece whose columns go together with those of others."""
    changed = ", ".join(
        f"CAST({named(name)} AS {type_}) AS {named(name)}"
        for name, type_ in casts.items()
        if name in piece.columns
    )
    if not changed:
        return f"({piece.sql})"
    return f"(SELECT * REPLACE ({changed}) FROM ({piece.sql}))"


ACTED: Final = (
    '"order" IS NOT NULL AND raised IS NULL '
    "AND NOT coalesce(terminated, false) AND NOT coalesce(truncated, false)"
)
"""Rows that are an action; those of an agent that had ended aren't."""


def returns_sql(columns: Iterable[str]) -> str:
    """A row for each agent and episode: what it was paid, and how many actions it took.

    Args:
        columns: of `steps`, whose reward terms are added up too; null where a run has no such term.
    """
    terms = "".join(
        f", fsum({named(name)}) AS {named(name)}" for name in columns if name.startswith(TERM)
    )
    return f"""
SELECT run, episode, agent, role, paid.* EXCLUDE (run, episode, agent)
FROM (
    SELECT run, episode, agent, coalesce(fsum(reward), 0) AS "return",
        count(*) FILTER (WHERE {ACTED}) AS length{terms}
    FROM steps GROUP BY run, episode, agent
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
    FROM steps GROUP BY run, episode, agent
) AS seen LEFT JOIN episodes AS said USING (run, episode)
"""
"""A row for each agent and episode: why and when it ended, as a summary counts it."""
ORDERS: Final = 'SELECT run, episode, turn, agent, "order" FROM steps WHERE "order" IS NOT NULL'
"""Who acted when; in a tick, in which place."""
