"""Checks by DuckDB's own parser that a query only reads.

The tree of a query is compared with a list of allowed nodes, not of harmful ones, so a kind of
node that a later DuckDB adds is refused until it stands here.
"""

import json
import re
from collections.abc import Iterator
from typing import Any, Final

from gamekeeper.errors import GamekeeperError

EXPLAIN: Final = re.compile(r"\s*explain\b(\s+analyze\b)?", re.IGNORECASE)
NODES: Final = frozenset(
    (
        *("SELECT_NODE", "SET_OPERATION_NODE", "RECURSIVE_CTE_NODE", "CTE_NODE"),
        *("BASE_TABLE", "SUBQUERY", "JOIN", "TABLE_FUNCTION", "EMPTY", "EXPRESSION_LIST"),
        *("SHOW_REF", "PIVOT", "COLUMN_DATA"),
        *("ORDER_MODIFIER", "LIMIT_MODIFIER", "LIMIT_PERCENT_MODIFIER", "DISTINCT_MODIFIER"),
        *("ORDER_DEFAULT", "ASCENDING", "DESCENDING"),
    )
)
"""Nodes of statements, of FROM, and of orders and limits; expressions have a class instead."""
TYPE_INFO: Final = "_TYPE_INFO"
"""Ending of the kinds of nodes that describe a column's type."""
TABLES: Final = frozenset(
    (
        *("unnest", "range", "generate_series", "repeat", "repeat_row", "query_table"),
        *("json_each", "json_tree", "histogram", "histogram_values"),
        *("duckdb_columns", "duckdb_functions", "duckdb_keywords", "duckdb_secrets"),
        *("duckdb_settings", "duckdb_types", "duckdb_views"),
    )
)
"""Functions whose tables depend only on their arguments, the views or DuckDB itself."""
VOLATILE: Final = frozenset(("random", "uuid", "gen_random_uuid", "uuidv4", "uuidv7", "error"))
"""Functions that give another value each time, but don't change anything."""


def reading(connection: Any, sql: str) -> str:
    """Returns the statement to run for `sql`, after checking that it only reads.

    Raises:
        GamekeeperError: it isn't one statement, or does more than read.
        duckdb.Error: it isn't SQL.
    """
    statements = connection.extract_statements(sql)
    kinds = [str(statement.type).rpartition(".")[2] for statement in statements]
    if len(kinds) != 1:
        raise _refused(" and ".join(kinds) or "no statement")
    explain = EXPLAIN.match(sql) if kinds == ["EXPLAIN"] else None
    judged = sql[explain.end() :] if explain else sql
    text = connection.execute("SELECT json_serialize_sql(?)", [judged]).fetchall()[0][0]
    tree = json.loads(text)
    if tree["error"]:  # it only serializes statements that select
        raise _refused(kinds[0])
    nodes = list(_nodes(tree["statements"]))
    functions = {str(node["function_name"]).lower() for node in nodes if "function_name" in node}
    for node in nodes:
        _check(node)
    volatile = _volatile(connection, functions)
    if volatile:
        raise _refused(f"the function {volatile[0]}")
    return f"{explain.group()} {judged}" if explain else sql


def _check(node: dict[str, Any]) -> None:
    kind = node.get("type")
    if "class" not in node and isinstance(kind, str):
        if kind not in NODES and not kind.endswith(TYPE_INFO):
            raise _refused(kind.removesuffix("_NODE").removesuffix("_QUERY"))
        if kind == "TABLE_FUNCTION":
            name = str(node["function"].get("function_name", "no function")).lower()
            if name not in TABLES:
                raise _refused(f"the function {name}")


def _volatile(connection: Any, names: set[str]) -> list[str]:
    """The functions that may change something: volatile, and not known to be harmless."""
    sql = "SELECT function_name FROM duckdb_functions() WHERE stability = 'VOLATILE'"
    asked = names - VOLATILE
    found = connection.execute(sql).fetchall() if asked else []
    return sorted(asked & {name for (name,) in found})


def _nodes(tree: Any) -> Iterator[dict[str, Any]]:
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, dict):
            yield node
            waiting += node.values()
        elif isinstance(node, list):
            waiting += node


def _refused(actual: str) -> GamekeeperError:
    is_pivot = actual == "MULTI"
    return GamekeeperError(
        "a query must be one statement that reads",
        where="the query",
        expected="SELECT, FROM, WITH, VALUES, PIVOT, DESCRIBE, SUMMARIZE or EXPLAIN",
        actual="PIVOT without IN" if is_pivot else actual,
        fix="name the values of a PIVOT: pivot orders on agent in ('a', 'b') using count(*)"
        if is_pivot
        else "write one statement over the runs that the command names; --out writes its rows "
        "into a file",
    )
