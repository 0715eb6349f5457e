"""Whose action changes what for whom, as an audit or an attribution measured it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.report.page.charts import matrix
from gamekeeper.report.page.data import Block, Cell, Chart, Table, name, number

KINDS: Final = ("observation", "reward", "ending")
MOST_AGENTS: Final = 40
"""Of a matrix; of more agents the strongest pairs are listed."""
MOST_PAIRS: Final = 30


def influence_blocks(rows: Sequence[Mapping[str, Any]], whose: str) -> tuple[Block, ...]:
    """Whose action changes whose observation, reward and ending: a matrix for each.

    Args:
        rows: as an audit or an attribution measured them.
        whose: how, in words.
    """
    rows = [row for row in rows if isinstance(row, Mapping)]
    if not rows:
        return ()
    agents = list(dict.fromkeys([*(row["from"] for row in rows), *(row["to"] for row in rows)]))
    told = (
        f"The share of replaced actions of one agent (row) that changed something for another "
        f"(column), at the lag with the largest share: {whose}, against a rerun with nothing "
        "changed. Under a share its 95 % interval; +1: one turn later."
    )
    if len(agents) > MOST_AGENTS:
        table = _pairs(rows)
        return (Block(title="Influence", notes=(told,), tables=(table,), anchor="influence"),)
    charts = tuple(filter(None, (_influence(rows, agents, kind) for kind in KINDS)))
    block = Block(title="Influence", notes=(told,), charts=charts, anchor="influence")
    return (block, Block(title="All measured influences", tables=(_pairs(rows),), folded=True))


def _influence(rows: Sequence[Mapping[str, Any]], agents: Sequence[str], kind: str) -> Chart | None:
    best: dict[tuple[str, str], Mapping[str, Any]] = {}
    for row in rows:
        key = (row["from"], row["to"])
        if row["on"] == kind and (key not in best or row["p"] > best[key]["p"]):
            best[key] = row
    if not best:
        return None
    grid = [[best.get((one, two)) for two in agents] for one in agents]
    return matrix(
        f"influence-{kind}", f"Influence on the {kind}", agents, agents,
        [[None if cell is None else cell["p"] for cell in line] for line in grid],
        labels=("whose action", f"whose {kind}"),
        texts=[[None if cell is None else _told(cell) for cell in line] for line in grid],
        bounds=(0.0, 1.0),
    )  # fmt: skip


def _told(row: Mapping[str, Any]) -> str:
    later = f" +{row['lag']}" if row["lag"] and row["p"] else ""
    return f"{row['p']:.0%}{later} ({row['low']:.0%} to {row['high']:.0%})"


def _pairs(rows: Sequence[Mapping[str, Any]]) -> Table:
    ordered = sorted(rows, key=lambda row: -float(row["p"]))
    shown = tuple(
        (
            name(row["from"]), name(row["to"]), Cell(str(row["on"])), number(row["lag"]),
            Cell(f"{row['p']:.0%}", "number"),
            Cell(f"{row['low']:.0%} to {row['high']:.0%}", "number"), number(row["n"]),
        )
        for row in ordered[:MOST_PAIRS]
    )  # fmt: skip
    more = len(ordered) - len(shown)
    columns = ("from", "to", "on", "turns later", "changed", "95 % interval", "looks")
    note = f"The strongest {MOST_PAIRS}; {more} more were measured." if more > 0 else ""
    return Table("Measured influences, the strongest first", columns, shown, note)
