"""`gamekeeper query RUN [RUN ...] SQL`: SQL over runs, read-only."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gamekeeper.cli._options import Count
from gamekeeper.cli._screen import CommandResult, Screen
from gamekeeper.errors import GamekeeperError

if TYPE_CHECKING:
    from gamekeeper.viewing.sql import Rows, Session

ORDER: Final = 115
SHOWN: Final = 40
"""Most rows that are shown by default."""


def command(
    screen: Screen,
    words: list[str],
    out: Path | None = None,
    rows: Count = SHOWN,
    check: bool = False,
) -> CommandResult:
    """Queries one or thousands of runs with SQL, read-only.

    Views: agent_steps, episodes, states and timings as recorded, with the column run; returns (by
    episode and agent, with reward terms), endings, orders, labels, runs and agents; evaluations,
    of folders that gamekeeper evaluate wrote. Runs that are still being recorded can be queried.
    Needs gamekeeper[query].

    Example: gamekeeper query 'runs/*' 'select agent, avg(return) from returns group by agent'

    Args:
        words (RUN|SQL): Folders of runs, folders of such folders, or patterns ('runs/*'); then the
            query, or - to read it from stdin. Without a query, views and columns are listed.
        out (--out FILE): File for all rows, .parquet or .csv (default: stdout).
        rows (--rows N): Most rows that are shown.
        check (--check): Compare every file with its checksum first.
    """
    from gamekeeper.viewing.sql import Session

    runs, sql = _split(words)
    with Session.of(*runs, check=check) as session:
        if sql is None:
            return _views(screen, session)
        asked = session.ask(sql)
        found = len(session.places.run_folders)
        if out is not None:
            count = asked.write(out)
            screen.show(f"Written  {out}: {count:,} rows")
            return CommandResult({"runs": found, "path": str(out), "rows_written": count})
        return _rows(screen, asked, found, rows)


def _rows(screen: Screen, asked: Rows, found: int, most: int) -> CommandResult:
    from gamekeeper.reporting.query_text import plain_value, query_text

    if screen.is_json:
        columns = [
            {"name": name, "type": type_}
            for name, type_ in zip(asked.columns, asked.types, strict=True)
        ]
        rows = [dict(zip(asked.columns, map(plain_value, row), strict=True)) for row in asked]
        return CommandResult({"runs": found, "columns": columns, "rows": rows})
    shown = asked.take(most + 1)
    has_more = len(shown) > most
    if any(name == "explain_value" for name in asked.columns):
        screen.program("\n".join(str(row[-1]) for row in shown))
        return CommandResult()
    screen.program(query_text(asked.columns, shown[:most], width=screen.width, more=has_more))
    if has_more:
        screen.note(f"the first {most} rows; --rows N shows more, --json and --out have all")
    return CommandResult()


def _views(screen: Screen, session: Session) -> CommandResult:
    from gamekeeper.reporting.query_text import views_text

    views: dict[str, Any] = {name: each for name, each in session.views.items() if name != "order"}
    screen.show(views_text(views, width=screen.width))
    return CommandResult({"runs": len(session.places.run_folders), "views": views})


def _split(words: list[str]) -> tuple[list[str], str | None]:
    """Splits runs from the query, which is the last word and has a space, or is `-`.

    Raises:
        GamekeeperError: there are no runs.
    """
    *before, last = words
    is_query = _is_query(last)
    if before and not is_query and any(_is_query(word) for word in before):
        raise GamekeeperError(
            "the query stands before a run",
            where="RUN|SQL",
            expected="runs first, then the query",
            actual=" ".join(words)[:200],
            fix="gamekeeper query runs/demo 'select * from returns'",
        )
    if not is_query:
        return words, None
    if not before:
        raise GamekeeperError(
            "the name of a run is missing",
            where="RUN",
            expected="at least one before the query",
            actual=last,
            fix="gamekeeper query runs/demo 'select * from returns'",
        )
    return before, sys.stdin.read() if last == "-" else last


def _is_query(word: str) -> bool:
    return word == "-" or (len(word.split()) > 1 and not Path(word).exists())
