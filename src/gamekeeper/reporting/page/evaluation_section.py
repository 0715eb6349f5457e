"""Section of an evaluation: claims, results by environment and policy, comparisons, cross-play."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.reporting.page.page_data import (
    Cell,
    PageBlock,
    PageSection,
    PageTable,
    anchor_of,
    bounds,
    forest,
    headings,
    interval,
    matrix,
    name,
    number,
    shown,
)
from gamekeeper.reporting.text_columns import MINUS

Document = Mapping[str, Any]

MOST_CLAIMS: Final = 8
"""Most claims of a list that is open at first; the tables have the same in numbers."""
MOST_CELLS: Final = 400
"""Pairings in a table."""


def evaluation_section(document: Document | None) -> PageSection | None:
    """All results of an evaluation; None without one."""
    if document is None:
        return None
    results = [each for each in document.get("results") or () if isinstance(each, Mapping)]
    blocks = [
        _head(document),
        _notes(document),
        _claims(document),
        *_crossplay(document.get("crossplay") or {}),
        PageBlock(
            title="Comparisons",
            charts=tuple(_differences(document)),
            tables=(_comparisons(document),),
        ),
        PageBlock(title="Results", tables=tuple(_results(results))),
        PageBlock(title="Refused claims", tables=(_refused(document),)),
        PageBlock(
            title="Commands",
            anchor="evaluation-commands",
            snippets=(("evaluate", "\n".join(map(str, document.get("commands") or ()))),)
            if document.get("commands")
            else (),
        ),
    ]
    return PageSection("evaluation", "Evaluation and cross-play", tuple(blocks))


def _head(document: Document) -> PageBlock:
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
            (
                f"policy {label}",
                f"{each.get('runs')} runs"
                if each.get("is_method")
                else ", ".join(map(str, each.get("digests") or ())),
            )
            for label, each in (document.get("policies") or {}).items()
        ),
    ]
    return PageBlock(facts=tuple(fact for fact in facts if fact[1]))


def _known(each: Document, keys: Sequence[str]) -> str:
    return ", ".join(f"{key} {each[key]}" for key in keys if each.get(key) is not None)


def _notes(document: Document) -> PageBlock:
    """Sentences on how it was played, and what the figures are about."""
    stopping = document.get("stopping")
    stopped = (f"Stopped: {_flat(stopping)}",) if stopping else ()
    return PageBlock(title="Notes", notes=(*map(str, document.get("notes") or ()), *stopped))


def _claims(document: Document) -> PageBlock:
    """Every supported claim, as the evaluation words it."""
    rows = tuple((Cell(str(claim)),) for claim in document.get("claims") or ())
    return PageBlock(
        title="Supported claims",
        tables=(PageTable("Supported claims", ("claim",), rows),),
        folded=len(rows) > MOST_CLAIMS,
    )


def _flat(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_flat(each)}" for key, each in value.items())
    return str(value)


# -- results


def _results(results: Sequence[Document]) -> Iterator[PageTable]:
    """A table for each environment and metric; agents and roles before the team."""
    order = {"agent": 0, "role": 1, "team": 2}
    columns = headings(
        "of | scope | policy | run | episodes | mean | 95 % interval | median | IQM | "
        "5 % to 95 % | success | 95 % interval | endings"
    )
    for title, rows in _by_metric(results).items():
        ranked = sorted(rows, key=lambda each: order.get(str(each.get("scope")), 3))
        yield PageTable(title, columns, tuple(map(_result, ranked)))


def _by_metric(rows: Iterable[Document]) -> dict[str, list[Document]]:
    """Rows by environment and metric, whose values have a common axis."""
    groups: dict[str, list[Document]] = {}
    for each in rows:
        groups.setdefault(f"{each.get('environment')}: {each.get('metric')}", []).append(each)
    return groups


def _result(each: Document) -> tuple[Cell, ...]:
    mean, success = each.get("mean") or {}, each.get("success") or {}
    quantiles = each.get("quantiles") or {}
    run = each.get("run")
    return (
        name(each.get("who")),
        Cell(str(each.get("scope"))),
        name(each.get("policy")),
        Cell(f"all {each.get('runs')}" if run is None else str(run)),
        number(each.get("episodes")),
        number(_value(each.get("mean"))),
        bounds(mean.get("low"), mean.get("high")),
        number(_value(each.get("median"))),
        number(_value(each.get("iqm"))),
        bounds(quantiles.get("0.05"), quantiles.get("0.95")),
        Cell(f"{success['p']:.0%} of {success['n']}" if success else "-", "number"),
        Cell(
            f"{success['low']:.0%} to {success['high']:.0%}"
            if success.get("low") is not None
            else "-",
            "number",
        ),
        Cell(_endings(each.get("endings") or {})),
    )


def _value(part: Any) -> float | None:
    found = part.get("value") if isinstance(part, Mapping) else part
    return found if isinstance(found, int | float) else None


def _endings(endings: Document) -> str:
    counts = {key: value for key, value in endings.items() if isinstance(value, int) and value}
    reasons = endings.get("reasons") or {}
    return ", ".join(f"{key} {value}" for key, value in {**counts, **reasons}.items())


# -- comparisons


def _comparisons(document: Document) -> PageTable:
    rows = tuple(
        (
            name(each.get("environment")),
            name(each.get("who")),
            name(each.get("metric")),
            name(each.get("a")),
            name(each.get("b")),
            number(each.get("n")),
            Cell(str(each.get("unit"))),
            number(difference.get("value")),
            bounds(difference.get("low"), difference.get("high")),
            number(difference.get("p")),
            number(improvement.get("value")),
            bounds(improvement.get("low"), improvement.get("high")),
        )
        for each in document.get("comparisons") or ()
        for difference in [each.get("difference") or {}]
        for improvement in [each.get("improvement") or {}]
    )
    columns = headings(
        f"environment | of | metric | A | B | n | unit | A {MINUS} B | 95 % interval | p | "
        "P(A > B) | 95 % interval"
    )
    return PageTable("Differences between policies", columns, rows)


def _differences(document: Document) -> Iterator[Document]:
    """A forest for each environment and metric."""
    compared = [each for each in document.get("comparisons") or () if each.get("difference")]
    for place, (title, group) in enumerate(_by_metric(compared).items()):
        rows = [
            {
                "name": f"{each.get('a')} {MINUS} {each.get('b')}",
                "group": str(each.get("who")),
                **{key: each["difference"].get(key) for key in ("value", "low", "high", "p")},
                "text": f"n = {each.get('n')} {each.get('unit')}s",
            }
            for each in group
        ]
        yield forest(
            f"evaluation-differences-{place}", title, rows, label="difference, 95 % interval"
        )


# -- cross-play


def _crossplay(crossplay: Mapping[str, Document]) -> Iterator[PageBlock]:
    for environment, played in crossplay.items():
        roles, cells = list(played.get("roles") or ()), list(played.get("cells") or ())
        charts = [_matrix(environment, roles, cells)] if len(roles) == 2 else []
        yield PageBlock(
            title=f"Cross-play in {environment}",
            charts=tuple(charts),
            tables=(_pairings(roles, cells), _best(played), _fairness(played)),
            notes=(
                "Self-play: the roles' policies were trained together. Zero-shot: they meet "
                "for the first time. Fixed: one of them is a fixed policy.",
            ),
        )


def _matrix(environment: str, roles: Sequence[str], cells: Sequence[Document]) -> Document:
    one, two = roles
    rows = list(dict.fromkeys(cell["roles"].get(one) for cell in cells))
    columns = list(dict.fromkeys(cell["roles"].get(two) for cell in cells))
    by_pair = {(cell["roles"].get(one), cell["roles"].get(two)): cell for cell in cells}
    grid = [[by_pair.get((row, column)) for column in columns] for row in rows]
    return matrix(
        f"crossplay-{anchor_of(environment)}",
        f"Mean return of each pair of policies in {environment}",
        [str(row) for row in rows],
        [str(column) for column in columns],
        [[None if cell is None else cell.get("mean") for cell in line] for line in grid],
        labels=(f"{one} played by", f"{two} played by"),
        texts=[[None if cell is None else _pairing(cell) for cell in line] for line in grid],
    )


def _pairing(cell: Document) -> str:
    text = _with_interval(cell.get("mean"), cell)
    return f"{text} {cell.get('kind')}" if cell.get("kind") != "zero-shot" else text


def _with_interval(value: float | None, part: Document) -> str:
    between = interval(part.get("low"), part.get("high"))
    return f"{shown(value)} ({between})" if between else shown(value)


def _pairings(roles: Sequence[str], cells: Sequence[Document]) -> PageTable:
    rows = tuple(
        (
            *(name(cell["roles"].get(role, "-")) for role in roles),
            Cell(str(cell.get("kind"))),
            number(cell.get("n")),
            number(cell.get("mean")),
            bounds(cell.get("low"), cell.get("high")),
            *(number((cell.get("by_role") or {}).get(role)) for role in roles),
        )
        for cell in cells[:MOST_CELLS]
    )
    columns = (
        *roles,
        "kind",
        "episodes",
        "mean",
        "95 % interval",
        *(f"return of {role}" for role in roles),
    )
    more = len(cells) - MOST_CELLS
    note = f"The first {MOST_CELLS} of {len(cells)} pairings." if more > 0 else ""
    return PageTable("Pairings", columns, rows, note)


def _best(played: Document) -> PageTable:
    """The best policy of a role with each line-up of the others, and its lead over the rest."""
    every = [each for each in played.get("best_response") or () if isinstance(each, Mapping)]
    rows = tuple(
        (
            name(each.get("role")),
            name(_flat(each.get("against") or {})),
            name(each.get("policy")),
            number(_value(each.get("value"))),
            name(policy),
            number(_value(gap)),
            bounds(gap.get("low"), gap.get("high")),
        )
        for each in every
        for policy, gap in (each.get("gap") or {}).items()
    )
    columns = ("role", "with", "best response", "value", "compared with", "lead", "95 % interval")
    notes = dict.fromkeys(str(each["note"]) for each in every if each.get("note"))
    text = " ".join(f"{note[:1].upper()}{note[1:]}." for note in notes)
    return PageTable("Best responses among the evaluated policies", columns, rows, text)


def _fairness(played: Document) -> PageTable:
    every = [each for each in played.get("fairness") or () if isinstance(each, Mapping)]
    columns = list(dict.fromkeys(key for each in every for key in each))
    rows = tuple(tuple(_any(each.get(key)) for key in columns) for each in every)
    return PageTable("Fairness", tuple(key.replace("_", " ") for key in columns), rows)


def _any(value: Any) -> Cell:
    if isinstance(value, Mapping) and "value" in value:
        return Cell(_with_interval(_value(value), value))
    if isinstance(value, int | float) and not isinstance(value, bool):
        return number(value)
    return Cell("-" if value is None else _flat(value))


def _refused(document: Document) -> PageTable:
    rows = tuple(
        (Cell(str(each.get("what"))), Cell(str(each.get("why"))))
        for each in document.get("refused") or ()
    )
    return PageTable("Refused claims", ("claim", "reason"), rows)
