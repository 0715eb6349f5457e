"""An attribution: what each agent brings, with intervals; who is lazy; who pays for whom."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gamekeeper.report.attribution_text import why_no_team
from gamekeeper.report.page.charts import forest
from gamekeeper.report.page.data import (
    Block,
    Cell,
    Chart,
    Table,
    badge,
    few,
    interval,
    name,
    number,
    percent,
    shown,
)

Document = Mapping[str, Any]


def attribution_blocks(document: Document) -> list[Block]:
    """What each agent brings, with intervals; who is lazy; who pays for whom."""
    team, agents = document["team"], document["agents"]
    if team.get("all") is None:
        told = f"Only single actions were replaced: {why_no_team(document)}."
    else:
        told = (
            f"In {document['fresh']} fresh episodes the team's return is {shown(team['all'])}; with"
            f" the baseline ({document['baseline']}) for everybody it is {shown(team['none'])}."
        )
    charts = [
        _parts(agents, "difference", "Lost without it: the baseline plays, the others react"),
        _parts(agents, "shapley", "Shapley value"),
    ]
    lazy = tuple(
        f"{who} is lazy: {part.get('lazy_why')}" for who, part in agents.items() if part.get("lazy")
    )
    return [
        Block(
            title="Attribution", alerts=lazy, notes=(told, *_open(agents)), anchor="attribution",
            charts=tuple(chart for chart in charts if chart["rows"]),
            tables=(_contributions(agents), _penalties(document), _messages(document),
                    _untested(document)),
        )
    ]  # fmt: skip


def _open(agents: Mapping[str, Document]) -> list[str]:
    """Of whom it can't be told whether they are lazy, and why."""
    reasons: dict[str, list[str]] = {}
    for who, part in agents.items():
        if part.get("lazy") is None:
            reasons.setdefault(str(part.get("lazy_why") or "no reason given"), []).append(who)
    return [f"Whether {few(who)} is lazy can't be told: {why}." for why, who in reasons.items()]


def _parts(agents: Mapping[str, Document], which: str, title: str) -> Chart:
    rows = [
        {"name": who, **{key: part[which].get(key) for key in ("value", "low", "high", "p")},
         "text": f"n = {part[which]['n']}"}
        for who, part in agents.items()
        if part.get(which)
    ]  # fmt: skip
    return forest(f"attribution-{which}", title, rows, label="team return, with 95 % intervals")


def _contributions(agents: Mapping[str, Document]) -> Table:
    rows = tuple(
        (
            name(who), number(part["own"]), percent(part["share"]), percent(part["idle"]),
            *_measured(part.get("difference")), *_measured(part.get("shapley")),
            *_measured((part.get("turn") or {}).get("all")), _lazy(part),
        )
        for who, part in agents.items()
    )  # fmt: skip
    columns = (
        "agent", "own return", "share", "idle", "lost without it", "95 % interval", "Shapley",
        "95 % interval", "still, others frozen", "95 % interval", "lazy",
    )  # fmt: skip
    return Table("What each agent brings", columns, rows)


def _measured(part: Document | None) -> tuple[Cell, Cell]:
    if part is None:
        return Cell("-", "number"), Cell("-", "number")
    bounds = interval(part["low"], part["high"]) or f"none of {part['n']} episodes"
    return number(part["value"]), Cell(bounds, "number")


def _lazy(part: Document) -> Cell:
    if part.get("lazy") is None:
        return Cell("can't be told")
    return badge("lazy", "warn") if part["lazy"] else Cell("no")


def _penalties(document: Document) -> Table:
    rows = tuple(
        (
            name(row["agent"]), Cell(row["term"]), name(", ".join(row["by"])),
            Cell(f"{row['p']:.0%} of {row['n']}", "number"),
            Cell(f"{row['low']:.0%} to {row['high']:.0%}", "number"),
            Cell(f"episode {row['first']['episode']}, turn {row['first']['turn']}"),
        )
        for row in document.get("penalties") or ()
        if row.get("first")
    )  # fmt: skip
    columns = ("who pays", "term", "whose doing", "payments", "95 % interval", "first")
    return Table("Penalties on the wrong participant", columns, rows)


def _messages(document: Document) -> Table:
    rows = []
    for row in document.get("messages") or ():
        if row["kind"] == "listening":
            told = (f"decides otherwise in {row['p']:.0%} of {row['n']} looks where it is shown "
                    f"another message ({row['low']:.0%} to {row['high']:.0%}; {row['sham']:.0%} "
                    "where it is shown the same)")  # fmt: skip
        else:
            told = f"{row['bits']:.2f} bits (p = {row['p']:.3f}, {row['n']} episodes)"
        pair = (name(row.get("from") or "-"), name(row.get("to") or "-"))
        rows.append((Cell(row["kind"]), *pair, Cell(told)))
    return Table("Messages", ("kind", "from", "to", "measured"), tuple(rows))


def _untested(document: Document) -> Table:
    rows = tuple(
        (Cell(str(each["what"])), Cell(str(each["why"])))
        for each in document.get("not_tested") or ()
    )
    return Table("Not looked at", ("what", "why"), rows)
