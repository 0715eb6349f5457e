"""Influence of agents on other agents as a table, for audits and attributions."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from gamekeeper.reporting.results_text import table_lines
from gamekeeper.reporting.text_columns import INDENT, indented, wrapped

MOST_ROWS: Final = 12
"""Rows that are shown; the JSON document has all of them."""
TITLE: Final = (
    "Influence: how often another legal action of one agent, all else repeated, changed the "
    "mask, observation, reward or ending of another agent"
)
UNITS: Final = {"rounds": "rounds (one turn of every live agent)", "steps": "env steps"}
LEGEND: Final = (
    "{lag} later: {unit} from the action to the first change: of a reward or ending, or of an "
    "observation or mask with which its agent decides; changed: share of the n replaced actions "
    "that changed it, also by what the environment then drew (95 % confidence interval); sorted "
    "by the lower end of the interval"
)


def lag_unit(api: str) -> str:
    """Unit of an audit's lags: env steps (Parallel), or rounds where agents take turns."""
    return "rounds" if api == "aec" else "steps"


def influence_text(
    influence: Iterable[Mapping[str, Any]], *, width: int, lag: str, least: float = 0
) -> str:
    """A row for each pair of agents and what was changed, at its first lag; maybe empty.

    Args:
        influence: rows with `from`, `to`, `on`, `lag`, `p`, `low`, `high`, `n`.
        lag: unit of the lags, a key of `UNITS`.
        least: lower end of the interval from which on an influence is shown, exclusive.
    """
    best: dict[tuple[str, str, str], Mapping[str, Any]] = {}
    for row in influence:
        key = (row["from"], row["to"], row["on"])
        is_shown = row["from"] != row["to"] and row["p"] > 0 and row["low"] >= least
        if is_shown and (key not in best or row["lag"] < best[key]["lag"]):
            best[key] = row
    # The share that is sure at least comes first: of few tries a high one is luck.
    shown = sorted(best.values(), key=lambda row: (row["low"], row["p"]), reverse=True)
    if not shown:
        return ""
    rows = [("from", "to", "on", f"{lag} later", "changed", "n")]
    for row in shown[:MOST_ROWS]:
        interval = f"{row['p']:.0%} ({row['low']:.0%} to {row['high']:.0%})"
        rows.append((row["from"], row["to"], row["on"], str(row["lag"]), interval, str(row["n"])))
    lines = [*wrapped(TITLE, width, rest=INDENT), *table_lines(rows, width=max(width, 80))]
    if len(shown) > MOST_ROWS:
        lines.append(f"{INDENT}and {len(shown) - MOST_ROWS} more (--json shows them)")
    return "\n".join([*lines, *indented(LEGEND.format(lag=lag, unit=UNITS[lag]), width)])
