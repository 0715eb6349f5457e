"""An evaluation as text: figures with their intervals, comparisons, columns, notes, claims."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.episodes.plain_json import legible
from gamekeeper.reporting.crowd import MOST_ROWS, crowd_rows
from gamekeeper.reporting.results_text import table_lines, table_text
from gamekeeper.reporting.text_columns import (
    INDENT,
    MINUS,
    columns_of,
    item_lines,
    items_text,
    wrapped,
)
from gamekeeper.statistics.interval import rounded

MOST_COMPARED: Final = 8
"""Most agents of whom a comparison is shown; the document has more."""
MOST_POLICIES: Final = 5
"""Policies that have a column in a table of agents."""
MOST_CELLS: Final = 30
MOST_RUNS: Final = 20
PROFILED: Final = (0.0, 0.25, 0.5, 0.75, 0.9)
"""Scores at which the text shows performance profiles; the document has more."""
RARE_ENDINGS: Final = ("cut", "failed", "mixed")
"""Endings that have a column only where there are any."""
COLUMNS: Final = {
    "of": "team: sum over its agents; a role: mean over its agents; or one agent",
    "IQM": "interquartile mean: the mean of the middle half",
    "5 to 95 %": "between these two values lie 90 % of the episodes (or training runs)",
    "success": "share of episodes that meet the specification's `success`; where it has none, of "
    "those that don't meet the contract's [failure]",
    "cut": "episodes that were stopped while agents were live, after most_turns steps",
    "failed": "episodes that an exception, or a reward that is NaN or infinite, ended",
    "mixed": "episodes in which agents ended in different ways",
    "kind": "self: one policy in all positions; fixed: different policies; zero-shot: runs of "
    "one method that never met in training",
    "p": "p-value of the difference, corrected for the number of comparisons (Holm); the "
    "interval beside it is not; a sign test where there is no interval",
    "d": "difference in standard deviations: of the paired differences (d_z), or of training runs "
    "(Cohen's d)",
    "P(A > B)": "probability that A is above B: in an episode of the same seed, or a training run "
    "of A above one of B; an equal pair counts half",
    "optimality gap": "mean amount by which scores are short of 1",
    "-": "undefined, or not declared",
}
"""Meaning of columns and signs that neither Gymnasium nor PettingZoo names."""
Row = Mapping[str, Any]


@legible
def evaluation_text(document: Mapping[str, Any], *, width: int) -> str:
    """Environment by environment: returns, success and endings, agents; then comparisons.

    Supported claims come first; below the tables the meaning of the columns, notes and refused
    claims.
    """
    blocks = ["\n".join(_head(document, width))]
    claims = items_text("Supported claims", document["claims"], width)
    blocks += [claims] if claims else []
    for name in document["environments"]:
        rows = [row for row in document["results"] if row["environment"] == name]
        blocks += [
            "\n".join(lines)
            for lines in (
                [f"Returns in {name}", *_returns(rows, document["level"], width)],
                [f"Endings in {name}, {_counted(rows)}", *_endings(rows, width)],
                [f"Mean return of each agent in {name}", *_agents(rows, width)],
            )
            if len(lines) > 1
        ]
        if name in document["crossplay"]:
            found = document["crossplay"][name]
            blocks.append("\n".join(_crossplay(name, found, document["level"], width)))
    for name, points in (document.get("curves") or {}).items():
        blocks += ["\n".join(lines) for lines in _curves(name, points, document["level"], width)]
    overall = document.get("overall") or {}
    if overall.get("results"):
        blocks.append("\n".join(_overall(overall, width)))
    if document["comparisons"]:
        blocks.append("\n".join(_comparisons(document["comparisons"], width)))
    tables = blocks[1 + bool(document["claims"]) :]
    heads = "\n".join(line for block in tables for line in block.splitlines())
    columns = [(word, text) for word, text in COLUMNS.items() if _has_word(heads, word)]
    blocks += [
        table_text("Columns", columns, width),
        items_text("Notes", document.get("notes") or (), width),
        items_text("Refused claims", _refused(document["refused"]), width),
    ]
    return "\n\n".join(filter(None, blocks))


def _refused(rows: Sequence[Row]) -> Iterator[str]:
    """Refused claims, a reason each, with the first claim that it is the reason of."""
    by_reason: dict[str, list[str]] = {}
    for row in rows:
        by_reason.setdefault(row["why"], []).append(row["what"])
    for why, what in by_reason.items():
        more = f"; likewise {len(what) - 1} more" if len(what) > 1 else ""
        yield f"{what[0]}{more}: {why}"


def _has_word(text: str, word: str) -> bool:
    """Tells if a column or a sign stands in the text of tables."""
    return re.search(rf"(?<![^\s(]){re.escape(word)}(?![^\s)])", text) is not None


def _head(document: Mapping[str, Any], width: int) -> Iterator[str]:
    policies, environments = len(document["policies"]), len(document["environments"])
    text = (
        f"Evaluated  {document['name']}: {policies} {'policy' if policies == 1 else 'policies'} "
        f"in {environments} {'environment' if environments == 1 else 'environments'}, "
        f"{document['episodes']:,} episodes each, seed {document['seed']}"
    )
    yield from wrapped(text, width, rest=INDENT)
    suite = document["suite"]
    if suite is not None:
        yield f"{INDENT}suite        {suite['id']} {suite['version']}  {suite['fingerprint']}"
    yield f"{INDENT}fingerprint  {document['fingerprint']}"


def _name(row: Row) -> str:
    return row["policy"] if row["run"] is None else f"{row['policy']}#{row['run']}"


def _shown(rows: Sequence[Row]) -> list[Row]:
    """Rows of the team and of roles, else of agents; a method's row covers all its runs."""
    over = {row["policy"] for row in rows if row["run"] is None}
    wide = [row for row in rows if (row["run"] is None) == (row["policy"] in over)]
    return [row for row in wide if row["scope"] != "agent"] or wide


def _returns(rows: Sequence[Row], level: float, width: int) -> Iterator[str]:
    shown = _shown([row for row in rows if row["metric"] == "return"])
    if not shown:
        return
    share = f"({100 * level:g} % interval)"
    head = ("policy", "of", f"mean {share}", f"IQM {share}", "5 to 95 %", "episodes")
    cells: list[tuple[str, ...]] = [head]
    for row in shown:
        quantiles = row["quantiles"]
        unit = f"{row['runs']} runs" if row["run"] is None else str(row["episodes"])
        cells.append(
            (
                row["policy"] if row["run"] in (None, 0) else _name(row),
                row["who"],
                _interval(row["mean"]),
                _interval(row["iqm"]),
                f"{quantiles['0.05']:z.3g} to {quantiles['0.95']:z.3g}",
                unit,
            )
        )
    yield from _fitted(cells, width, right=(4, 5), spare=(4, 3))
    yield from _runs(rows, width)


def _runs(rows: Sequence[Row], width: int) -> Iterator[str]:
    """The training runs of methods, one by one."""
    over = [row for row in rows if row["run"] is None and row["metric"] == "return"]
    for method in over:
        key = (method["policy"], method["scope"], method["who"])
        if method["scope"] == "agent":
            continue
        means = [
            _value(row["mean"])
            for row in rows
            if (row["policy"], row["scope"], row["who"]) == key
            and row["metric"] == "return"
            and row["run"] is not None
        ]
        more = f" and {len(means) - MOST_RUNS} more" if len(means) > MOST_RUNS else ""
        text = f"runs of {key[0]}, {key[2]}: {', '.join(means[:MOST_RUNS])}{more}"
        yield from item_lines(text, width)


def _counted(rows: Sequence[Row]) -> str:
    """The unit in which endings are counted."""
    has_roles = any(row["scope"] == "role" for row in _shown(rows))
    return "number of episodes" + (" (a role's row counts each of its agents)" if has_roles else "")


def _endings(rows: Sequence[Row], width: int) -> Iterator[str]:
    shown = _shown([row for row in rows if row["endings"] is not None])
    if not shown:
        return
    rare = [kind for kind in RARE_ENDINGS if any(row["endings"].get(kind) for row in shown)]
    kinds = ["terminated", "truncated", *rare]
    cells: list[tuple[str, ...]] = [("policy", "of", "success", *kinds, "reasons")]
    for row in shown:
        ends = row["endings"]
        reasons = ", ".join(f"{name} {count}" for name, count in ends["reasons"].items())
        cells.append(
            (
                row["policy"] if row["run"] in (None, 0) else _name(row),
                row["who"],
                _share(row["success"]),
                *(str(ends.get(kind, 0)) for kind in kinds),
                reasons,
            )
        )
    spare = 2 + len(kinds) if "mixed" in rare else 4  # reasons have the mixed ones, too
    yield from _fitted(cells, width, right=range(3, 3 + len(kinds)), spare=(spare,))


def _agents(rows: Sequence[Row], width: int) -> Iterator[str]:
    """Mean returns, a line for each agent, a column for each policy."""
    returns = [row for row in rows if row["metric"] == "return"]
    over = {row["policy"] for row in returns if row["run"] is None}
    shown = [
        row
        for row in returns
        if row["scope"] == "agent" and row["run"] == (None if row["policy"] in over else 0)
    ]
    agents = list(dict.fromkeys(row["who"] for row in shown))
    policies = list(dict.fromkeys(row["policy"] for row in shown))[:MOST_POLICIES]
    # Without rows of the team and of roles, agents have been shown in their place.
    if len(agents) < 2 or all(row["scope"] == "agent" for row in returns):
        return
    means = {(row["policy"], row["who"]): row["mean"] for row in shown}
    cells = [
        (agent, *(_value(means.get((policy, agent))) for policy in policies)) for agent in agents
    ]
    values = [(means.get((policies[0], agent)) or {}).get("value") for agent in agents]
    table = [("agent", *policies), *crowd_rows(cells, values, _number)]
    yield from table_lines(table, width=width, right=range(1, len(policies) + 1))


def _comparisons(rows: Sequence[Row], width: int) -> Iterator[str]:
    yield "Compared on the same seeds"
    cells: list[tuple[str, ...]] = [
        ("environment", f"A {MINUS} B", "of", "metric", "difference", "p", "d", "P(A > B)")
    ]
    shown, others = _told_apart(rows)
    for row in shown:
        difference, improvement = row["difference"], row["improvement"]
        p, size = ((difference or {}).get(key) for key in ("p", "effect_size"))
        cells.append(
            (
                row["environment"],
                f"{row['a']} {MINUS} {row['b']}",
                row["who"],
                row["metric"],
                _interval(difference, sign="+"),
                "-" if p is None else f"{p:.2g}",
                "-" if size is None else f"{size:+z.2f}",
                _share(improvement and {"p": improvement["value"], **improvement}),
            )
        )
    if len({cell[0] for cell in cells[1:]}) == 1:  # one environment needs no column
        cells = [cell[1:] for cell in cells]
    last = len(cells[0]) - 1
    yield from _fitted(cells, width, right=(last - 2, last - 1), spare=(last - 1, last, last - 2))
    if others:
        yield f"{INDENT}... and {others} more of single agents; --json has each"


def _told_apart(rows: Sequence[Row]) -> tuple[list[Row], int]:
    """Comparisons of teams and roles, and those of agents with the least p; how many more."""

    def key(row: Row) -> tuple[float, float]:
        difference = row["difference"] or {}
        p, value = difference.get("p"), difference.get("value")
        return (1.0 if p is None else p, -abs(value or 0.0))

    agents = sorted((row for row in rows if row["scope"] == "agent"), key=key)
    left_out = {id(row) for row in agents[MOST_COMPARED:]} if len(agents) > MOST_ROWS else set()
    return [row for row in rows if id(row) not in left_out], len(left_out)


def _curves(name: str, points: Sequence[Row], level: float, width: int) -> Iterator[list[str]]:
    """A learning curve, a table for each environment: the return by training steps."""
    returns = [row for row in points if row["metric"] == "return"]
    for environment in dict.fromkeys(row["environment"] for row in returns):
        mine = [row for row in returns if row["environment"] == environment]
        shown = [row for row in mine if row["scope"] != "agent"] or mine
        share = f"({100 * level:g} % interval)"
        cells: list[tuple[str, ...]] = [
            ("steps", "of", f"mean {share}", f"IQM {share}", "episodes")
        ]
        for row in shown:
            unit = f"{row['runs']} runs" if row["runs"] > 1 else str(row["episodes"])
            figures = (_interval(row["mean"]), _interval(row["iqm"]))
            cells.append((f"{row['step']:,}", row["who"], *figures, unit))
        title = f"Learning curve of {name} in {environment}, return by training steps"
        yield [title, *_fitted(cells, width, right=(0, 4), spare=(3,))]


def _overall(overall: Mapping[str, Any], width: int) -> Iterator[str]:
    yield "Over all environments"
    cells: list[tuple[str, ...]] = [
        ("policy", "metric", "IQM", "mean", "median", "optimality gap", "runs")
    ]
    for row in overall["results"]:
        figures = [_interval(row["iqm"]), _interval(row["mean"])]
        more = [_value(row[key]) for key in ("median", "optimality_gap")]
        cells.append((row["policy"], row["metric"], *figures, *more, str(row["runs"])))
    yield from _fitted(cells, width, right=(4, 5, 6), spare=(5, 4, 2))
    yield from _profiles([row for row in overall["results"] if row["unit"] == "run"], width)
    for row in overall["comparisons"]:
        if row["improvement"] is not None:
            chance = {k: 100 * row["improvement"][k] for k in ("value", "low", "high")}
            text = f"P({row['a']} > {row['b']}) in {row['metric']}: {_interval(chance)} %"
            yield from item_lines(text, width)


def _profiles(rows: Sequence[Row], width: int) -> Iterator[str]:
    """Performance profiles: the part of the runs above each of a few scores."""
    if not rows:
        return
    taus = rows[0]["profile"]["tau"]
    places = [taus.index(tau) for tau in PROFILED if tau in taus]
    head = ("share of runs above", "metric", *(f"{taus[place]:g}" for place in places))
    cells: list[tuple[str, ...]] = [head]
    for row in rows:
        shares = (f"{100 * row['profile']['share'][place]:.0f} %" for place in places)
        cells.append((row["policy"], row["metric"], *shares))
    yield from _fitted(cells, width, right=range(2, len(head)), spare=())


def _crossplay(name: str, found: Mapping[str, Any], level: float, width: int) -> Iterator[str]:
    """Cells, then the best policies by position, then both ways of sitting."""
    roles = found["roles"]
    yield f"Cross-play in {name}, return of {found['who']}"
    share = f"mean ({100 * level:g} % interval)"
    cells = [(*roles, "kind", "episodes", share, "return by position")]
    for cell in found["cells"][:MOST_CELLS]:
        own = ", ".join(_number(cell["by_role"][role]) for role in roles)
        policies = (cell["roles"][role] for role in roles)
        mean = {"value": cell["mean"], "low": cell["low"], "high": cell["high"]}
        n = f"{cell['n']} runs" if cell.get("unit") == "run" else str(cell["n"])
        cells.append((*policies, cell["kind"], n, _interval(mean), own))
    yield from _fitted(cells, width, right=(len(roles) + 1,), spare=())
    if len(found["cells"]) > MOST_CELLS:
        yield f"{INDENT}... and {len(found['cells']) - MOST_CELLS} more pairings (--json has them)"
    for row in found["best_response"]:
        against = next(iter(row["against"].values()), "")
        gaps = [
            f"{policy} by {_interval(gap, sign='+')}" for policy, gap in row["gap"].items() if gap
        ]
        text = f"best as {row['role']} with {against}: {row['policy']}, {_number(row['value'])}"
        yield from item_lines(f"{text}; ahead of {', '.join(gaps)}", width)
    if found["best_response"]:
        yield f"{INDENT}best: chosen on half of the episodes, measured on the others"
    for row in found["fairness"]:
        a, b = row["policies"]
        pair = f"{a} with itself" if a == b else f"{a} with {b}, both ways"
        leader, lead = _leader(row["roles"], row["first_mover"])
        text = f"{pair}: {leader} leads by {_interval(lead)}"
        if row["difference"] is not None:
            text += f"; {a} {MINUS} {b} {_interval(row['difference'], sign='+')}"
        yield from item_lines(text, width)


def _leader(roles: Sequence[str], lead: Row | None) -> tuple[str, Row | None]:
    """The role that is ahead, and by how much; `lead` is that of the first."""
    if lead is None or (lead["value"] or 0.0) >= 0.0:
        return roles[0], lead
    low, high = (None if lead[key] is None else -lead[key] for key in ("high", "low"))
    return roles[1], {"value": -lead["value"], "low": low, "high": high}


def _fitted(
    cells: Sequence[tuple[str, ...]], width: int, *, right: Sequence[int], spare: Sequence[int]
) -> Iterator[str]:
    """A table without those of its spare columns that don't fit."""
    columns = list(range(len(cells[0])))
    for spare_column in (*spare, None):
        lines = list(
            table_lines(
                [[row[k] for k in columns] for row in cells],
                width=width,
                right=[place for place, k in enumerate(columns) if k in right],
            )
        )
        if spare_column is None or max(map(columns_of, lines)) <= width:
            break
        columns.remove(spare_column)
    yield from lines


def _value(found: Row | None) -> str:
    return "-" if found is None else _number(found["value"])


def _number(value: float | None, sign: str = "") -> str:
    return "-" if value is None else f"{value:{sign}z.4g}"


def _interval(found: Row | None, sign: str = "") -> str:
    """Formats `36 (34.9 to 37.1)`; without an interval the value alone."""
    if found is None or found["value"] is None:
        return "-"
    if found["low"] is None:
        return _number(found["value"], sign)
    value, low, high = found["value"], found["low"], found["high"]
    shown = [rounded(each, low, high, sign=sign) for each in (value, low, high)]
    return f"{shown[0]} ({shown[1]} to {shown[2]})"


def _share(success: Row | None) -> str:
    """Formats `100 % (94 to 100)`."""
    if success is None:
        return "-"
    share = f"{100 * success['p']:.0f} %"
    if success["low"] is None:
        return share
    return f"{share} ({100 * success['low']:.0f} to {100 * success['high']:.0f})"
