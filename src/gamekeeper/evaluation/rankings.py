"""Rankings of policies in cross-play: the matrix of payoffs, cycles, and their alpha-rank."""

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gamekeeper.evaluation.comparisons import ALPHA, POSITIONS
from gamekeeper.evaluation.matchups import ZERO_SHOT
from gamekeeper.statistics.ranking import alpha_rank, cycle_of

Row = Mapping[str, Any]


def payoffs_of(crossed: Row) -> dict[str, Any] | None:
    """The matrix of mean returns by policies in two positions; None where there are more.

    Runs of one method meet one another in its diagonal cell, where they do.
    """
    roles = crossed["roles"]
    if len(roles) != 2:
        return None
    means: dict[tuple[str, str], float | None] = {}
    for cell in crossed["cells"]:
        key = (cell["roles"][roles[0]], cell["roles"][roles[1]])
        if key not in means or cell["kind"] == ZERO_SHOT:
            means[key] = cell["mean"]
    names = list(crossed["policies"])
    rows = [[means.get((a, b)) for b in names] for a in names]
    return {"rows": roles[0], "columns": roles[1], "policies": names, "means": rows}


def csv_of(payoffs: Row) -> str:
    """A matrix of payoffs as CSV: a policy a row, an opponent or partner a column."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f"{payoffs['rows']} / {payoffs['columns']}", *payoffs["policies"]])
    for name, row in zip(payoffs["policies"], payoffs["means"], strict=True):
        writer.writerow([name, *("" if value is None else repr(value) for value in row)])
    return text.getvalue()


def ranking_of(comparisons: Sequence[Row]) -> dict[str, Any] | None:
    """The cycle among an environment's rivals and their alpha-rank; None where none was claimed.

    Only claims count: whose difference isn't shown, is no edge of a cycle.
    """
    rows = [row for row in comparisons if row["scope"] == POSITIONS]
    names = list(dict.fromkeys(name for row in rows for name in (row["a"], row["b"])))
    beats = np.zeros((len(names), len(names)), np.bool_)
    for row in rows:
        difference = row["difference"] or {}
        p = difference.get("p")
        if p is not None and p <= ALPHA:
            pair = (row["a"], row["b"]) if difference["value"] > 0 else (row["b"], row["a"])
            beats[names.index(pair[0]), names.index(pair[1])] = True
    cycle = cycle_of(beats)
    if not cycle:
        return None
    shares = dict(zip(names, alpha_rank(beats).tolist(), strict=True))
    return {"cycle": [names[place] for place in cycle], "alpha_rank": shares}
