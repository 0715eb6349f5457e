"""`gamekeeper query RUN [RUN ...] SQL`: SQL over bundles, read-only."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from gamekeeper.cli._options import MOST
from gamekeeper.cli._screen import Answer, Screen
from gamekeeper.errors import GamekeeperError

if TYPE_CHECKING:
    from gamekeeper.adapters.sql import Rows, Session

ORDER: Final = 115
SHOWN: Final = 40
"""Rows that are shown unless told."""

WordsArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="RUN|SQL", show_default=False,
        help="Folders of evidence, folders of such folders, patterns ('runs/*'); then the query, "
        "- reads it from stdin. Without a query, the views and their columns.",
    ),
]  # fmt: skip
OutOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="FILE", help="Writes all rows there: .parquet or .csv."),
]
RowsOption = Annotated[
    int, typer.Option("--rows", metavar="N", min=1, max=MOST, help="How many are shown at most.")
]
CheckOption = Annotated[
    bool, typer.Option("--check", help="Compare every file with its seal first.")
]


def command(
    screen: Screen,
    words: WordsArgument,
    out: OutOption = None,
    rows: RowsOption = SHOWN,
    check: CheckOption = False,
) -> Answer:
    """Asks one or thousands of runs with SQL; changes nothing, reads nothing else.

    Views: steps, episodes, states, timings as recorded, with the column run; returns (by episode
    and agent, with reward terms), endings, orders, labels, runs, agents; evaluations of folders
    that gamekeeper evaluate wrote. Also of runs that are still recorded. Needs gamekeeper[query].
    """
    from gamekeeper.adapters.sql import Session

    runs, sql = _split(words)
    with Session.of(*runs, check=check) as session:
        if sql is None:
            return _views(screen, session)
        asked = session.ask(sql)
        found = len(session.places.bundles)
        if out is not None:
            count = asked.write(out)
            screen.show(f"Written  {out}: {count:,} rows")
            return Answer({"runs": found, "path": str(out), "rows_written": count})
        return _rows(screen, asked, found, rows)


def _rows(screen: Screen, asked: Rows, found: int, most: int) -> Answer:
    from gamekeeper.report.query_text import plain_value, query_text

    if screen.is_json:
        columns = [
            {"name": name, "type": type_}
            for name, type_ in zip(asked.columns, asked.types, strict=True)
        ]
        rows = [dict(zip(asked.columns, map(plain_value, row), strict=True)) for row in asked]
        return Answer({"runs": found, "columns": columns, "rows": rows})
    shown = asked.take(most + 1)
    has_more = len(shown) > most
    if any(name == "explain_value" for name in asked.columns):
        screen.program("\n".join(str(row[-1]) for row in shown))
        return Answer()
    screen.program(query_text(asked.columns, shown[:most], width=screen.width, more=has_more))
    if has_more:
        screen.note(f"the first {most} rows; --rows N shows more, --json and --out have all")
    return Answer()


def _views(screen: Screen, session: Session) -> Answer:
    from gamekeeper.report.query_text import views_text

    views: dict[str, Any] = {name: each for name, each in session.views.items() if name != "order"}
    screen.show(views_text(views, width=screen.width))
    return Answer({"runs": len(session.places.bundles), "views": views})


def _split(words: list[str]) -> tuple[list[str], str | None]:
    """The runs, and the query where the last word is one: it has a blank, no folder's name has.

    Raises:
        GamekeeperError: there are no runs.
    """
    *before, last = words
    is_query = _is_query(last)
    if before and not is_query and any(_is_query(word) for word in before):
        raise GamekeeperError(
            "the query stands before a run", where="RUN|SQL", expected="runs first, then the query",
            seen=" ".join(words)[:200], mend="gamekeeper query runs/demo 'select * from returns'",
        )  # fmt: skip
    if not is_query:
        return words, None
    if not before:
        raise GamekeeperError(
            "no run is named", where="RUN", expected="at least one before the query", seen=last,
            mend="gamekeeper query runs/demo 'select * from returns'",
        )  # fmt: skip
    return before, sys.stdin.read() if last == "-" else last


def _is_query(word: str) -> bool:
    return word == "-" or (len(word.split()) > 1 and not Path(word).exists())
