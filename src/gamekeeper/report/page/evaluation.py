"""An evaluation: results by environment and policy, comparisons, the cross-play matrix."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.report.page.charts import forest, matrix
from gamekeeper.report.page.data import Block, Cell, Section, Table, interval, name, number, shown

Document = Mapping[str, Any]

MOST_CLAIMS: Final = 8
"""Shown at once; of more the list is folded, and the tables say the same in numbers."""
MOST_CELLS: Final = 400
"""Pairings in a table."""


def evaluation_section(document: Document | None) -> Section:
    """Everything an evaluation says; without one, how to have it.

    Args:
        document: `evaluation.json` of `gamekeeper evaluate`.
    """
    title = "Evaluation and cross-play"
    if document is None:
        return Section(
            "evaluation",
            title,
            missing="No evaluation was given. `gamekeeper evaluate ... --out FOLDER`, then "
            "`gamekeeper report RUN --evaluation FOLDER/evaluation.json`.",
        )
    results = [each for each in document.get("results") or () if isinstance(each, Mapping)]
    blocks = [
        _head(document),
        _claims(document),
        *_crossplay(document.get("crossplay") or {}),
        Block(
            title="Comparisons",
            charts=tuple(_differences(document)),
            tables=(_comparisons(document),),
        ),
        Block(title="Results", tables=tuple(_results(results))),
        Block(title="Refused", tables=(_refused(document),)),
        Block(
            title="Commands that play it again",
            anchor="evaluation-commands",
            snippets=(("evaluate", "\n".join(map(str, document.get("commands") or ()))),)
            if document.get("commands")
            else (),
        ),
    ]
    return Section("evaluation", title, tuple(blocks))


def _head(document: Document) -> Block:
    suite = document.get("suite") or {}
    facts = [
        ("name", str(document.get("name"))),
        ("suite", f"{suite.get('id')}, fingerprint {suite.get('fingerprint')}" if suite else ""),
        ("seed", str(document.get("seed"))),
        ("episodes", shown(document.get("episodes"))),
        *(
            (f"environment {label}", _known(each, ("spec", "version", "digest")))
            for label, each in (document.get("environments") or {}).items()
        ),
        *(
            (f"policy {label}", f"{each.get('runs')} runs" if each.get("is_method")
             else ", ".join(map(str, each.get("digests") or ())))
            for label, each in (document.get("policies") or {}).items()
        ),
    ]  # fmt: skip
    return Block(facts=tuple(fact for fact in facts if fact[1]))


def _known(each: Document, keys: Sequence[str]) -> str:
    return ", ".join(f"{key} {each[key]}" for key in keys if each.get(key) is not None)


def _claims(document: Document) -> Block:
    """Every claim in the words in which it was made, in a list of its own."""
    rows = tuple((Cell(str(claim)),) for claim in document.get("claims") or ())
    stopping = document.get("stopping")
    return Block(
        title="What is claimed",
        notes=(f"Stopped: {_flat(stopping)}",) if stopping else (),
        tables=(Table("Claims, and what they are about", ("claim",), rows),),
        folded=len(rows) > MOST_CLAIMS,
    )


def _flat(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_flat(each)}" for key, each in value.items())
    return str(value)


# -- results


def _results(results: Sequence[Document]) -> Iterator[Table]:
    """A table for each environment and metric; agents and roles before the team."""
    groups: dict[tuple[str, str], list[Document]] = {}
    for each in results:
        groups.setdefault((str(each.get("environment")), str(each.get("metric"))), []).append(each)
    order = {"agent": 0, "role": 1, "team": 2}
    for (environment, metric), rows in groups.items():
        rows = sorted(rows, key=lambda each: order.get(str(each.get("scope")), 3))
        columns = (
            "who", "scope", "policy", "run", "episodes", "mean", "95 % interval", "median", "IQM",
            "5 % to 95 %", "success", "95 % interval", "endings",
        )  # fmt: skip
        yield Table(f"{environment}: {metric}", columns, tuple(_result(each) for each in rows))


def _result(each: Document) -> tuple[Cell, ...]:
    mean, success = each.get("mean") or {}, each.get("success") or {}
    quantiles = each.get("quantiles") or {}
    run = each.get("run")
    return (
        name(each.get("who")), Cell(str(each.get("scope"))), name(each.get("policy")),
        Cell(f"all {each.get('runs')}" if run is None else str(run)),
        number(each.get("episodes")), number(_value(each.get("mean"))),
        Cell(interval(mean.get("low"), mean.get("high")) or "-", "number"),
        number(_value(each.get("median"))), number(_value(each.get("iqm"))),
        Cell(interval(quantiles.get("0.05"), quantiles.get("0.95")) or "-", "number"),
        Cell(f"{success['p']:.0%} of {success['n']}" if success else "-", "number"),
        Cell(f"{success['low']:.0%} to {success['high']:.0%}" if _bounded(success) else "-",
             "number"),
        Cell(_endings(each.get("endings") or {})),
    )  # fmt: skip


def _bounded(part: Document) -> bool:
    return part.get("low") is not None and part.get("high") is not None


def _value(part: Any) -> float | None:
    found = part.get("value") if isinstance(part, Mapping) else part
    return found if isinstance(found, int | float) else None


def _endings(endings: Document) -> str:
    counts = {key: value for key, value in endings.items() if isinstance(value, int) and value}
    reasons = endings.get("reasons") or {}
    return ", ".join(f"{key} {value}" for key, value in {**counts, **reasons}.items())


# -- comparisons


def _comparisons(document: Document) -> Table:
    rows = tuple(
        (
            name(each.get("environment")), name(each.get("who")), name(each.get("metric")),
            name(each.get("a")), name(each.get("b")), number(each.get("n")),
            Cell(str(each.get("unit"))), number(difference.get("value")),
            Cell(interval(difference.get("low"), difference.get("high")) or "-", "number"),
            number(difference.get("p")), number(improvement.get("value")),
            Cell(interval(improvement.get("low"), improvement.get("high")) or "-", "number"),
        )
        for each in document.get("comparisons") or ()
        for difference in [each.get("difference") or {}]
        for improvement in [each.get("improvement") or {}]
    )  # fmt: skip
    columns = (
        "environment", "who", "metric", "a", "b", "n", "unit", "a - b", "95 % interval", "p",
        "a beats b", "95 % interval",
    )  # fmt: skip
    return Table("Policies against one another", columns, rows)


def _differences(document: Document) -> Iterator[Document]:
    """A forest for each environment and metric: returns and shares have no axis in common."""
    groups: dict[tuple[str, str], list[Document]] = {}
    for each in document.get("comparisons") or ():
        if each.get("difference"):
            key = (str(each.get("environment")), str(each.get("metric")))
            groups.setdefault(key, []).append(each)
    for place, ((environment, metric), group) in enumerate(groups.items()):
        rows = [
            {"name": f"{each.get('a')} - {each.get('b')}", "group": str(each.get("who")),
             **{key: each["difference"].get(key) for key in ("value", "low", "high", "p")},
             "text": f"n = {each.get('n')} {each.get('unit')}s"}
            for each in group
        ]  # fmt: skip
        yield forest(f"evaluation-differences-{place}", f"{environment}: {metric}", rows,
                     label="difference, with its 95 % interval")  # fmt: skip


# -- cross-play


def _crossplay(crossplay: Mapping[str, Document]) -> Iterator[Block]:
    for environment, played in crossplay.items():
        roles, cells = list(played.get("roles") or ()), list(played.get("cells") or ())
        charts = [_matrix(environment, roles, cells)] if len(roles) == 2 else []
        yield Block(
            title=f"Cross-play in {environment}",
            charts=tuple(charts),
            tables=(_pairings(roles, cells), _best(played), _fairness(played)),
            notes=("Self-play: the roles' policies were trained together. Zero-shot: they meet "
                   "for the first time. Fixed: one of them is a fixed policy.",),
        )  # fmt: skip


def _matrix(environment: str, roles: Sequence[str], cells: Sequence[Document]) -> Document:
    one, two = roles
    rows = list(dict.fromkeys(cell["roles"].get(one) for cell in cells))
    columns = list(dict.fromkeys(cell["roles"].get(two) for cell in cells))
    by_pair = {(cell["roles"].get(one), cell["roles"].get(two)): cell for cell in cells}
    grid = [[by_pair.get((row, column)) for column in columns] for row in rows]
    place = "".join(sign for sign in environment if sign.isascii() and sign.isalnum())
    return matrix(
        f"crossplay-{place}", f"Who does how well with whom in {environment}",
        [str(row) for row in rows], [str(column) for column in columns],
        [[None if cell is None else cell.get("mean") for cell in line] for line in grid],
        labels=(f"{one} played by", f"{two} played by"),
        texts=[[None if cell is None else _told(cell) for cell in line] for line in grid],
    )  # fmt: skip


def _told(cell: Document) -> str:
    bounds = interval(cell.get("low"), cell.get("high"))
    text = f"{shown(cell.get('mean'))}" + (f" ({bounds})" if bounds else "")
    return f"{text} {cell.get('kind')}" if cell.get("kind") != "zero-shot" else text


def _pairings(roles: Sequence[str], cells: Sequence[Document]) -> Table:
    rows = tuple(
        (
            *(name(cell["roles"].get(role, "-")) for role in roles), Cell(str(cell.get("kind"))),
            number(cell.get("n")), number(cell.get("mean")),
            Cell(interval(cell.get("low"), cell.get("high")) or "-", "number"),
            *(number((cell.get("by_role") or {}).get(role)) for role in roles),
        )
        for cell in cells[:MOST_CELLS]
    )  # fmt: skip
    columns = (
        *roles, "kind", "episodes", "mean", "95 % interval", *(f"{role}'s own" for role in roles)
    )  # fmt: skip
    more = len(cells) - MOST_CELLS
    note = f"The first {MOST_CELLS} of {len(cells)} pairings." if more > 0 else ""
    return Table("Pairings", columns, rows, note)


def _best(played: Document) -> Table:
    """The best answer to each line-up of the others, and its lead over every other policy."""
    every = [each for each in played.get("best_response") or () if isinstance(each, Mapping)]
    rows = tuple(
        (
            name(each.get("role")), name(_flat(each.get("against") or {})),
            name(each.get("policy")), number(_value(each.get("value"))), name(policy),
            number(_value(gap)),
            Cell(interval(gap.get("low"), gap.get("high")) or "-", "number"),
        )
        for each in every
        for policy, gap in (each.get("gap") or {}).items()
    )  # fmt: skip
    columns = (
        "role", "against", "best response", "value", "compared with", "lead", "95 % interval",
    )  # fmt: skip
    notes = dict.fromkeys(str(each["note"]) for each in every if each.get("note"))
    return Table(
        "Best responses among those that played", columns, rows, " ".join(map(_sentence, notes))
    )


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _fairness(played: Document) -> Table:
    every = [each for each in played.get("fairness") or () if isinstance(each, Mapping)]
    columns = list(dict.fromkeys(key for each in every for key in each))
    rows = tuple(tuple(_any(each.get(key)) for key in columns) for each in every)
    return Table("Fairness", tuple(key.replace("_", " ") for key in columns), rows)


def _any(value: Any) -> Cell:
    if isinstance(value, Mapping) and "value" in value:
        bounds = interval(value.get("low"), value.get("high"))
        return Cell(shown(_value(value)) + (f" ({bounds})" if bounds else ""))
    if isinstance(value, int | float) and not isinstance(value, bool):
        return number(value)
    return Cell("-" if value is None else _flat(value))


def _refused(document: Document) -> Table:
    rows = tuple(
        (Cell(str(each.get("what"))), Cell(str(each.get("why"))))
        for each in document.get("refused") or ()
    )
    return Table("Claims that weren't made", ("what", "why"), rows)
