"""The game form as an audit measured it, beside what the contract declares."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from gamekeeper.core.contract.places import one_line
from gamekeeper.report.columns import columns_of, filled, wrapped
from gamekeeper.report.text import table_lines

Document = Mapping[str, Any]

INDENT: Final = "  "
APART: Final = ("influence", "advice", "why")
"""Keys of `measured` that are no rows of the table."""
DECLARED: Final[Mapping[str, tuple[tuple[str, ...], ...]]] = {
    "schedule": (("schedule", "stages"), ("schedule", "order"), ("schedule", "observe")),
    "order_sensitive": (("schedule", "conflicts"),),
    "deterministic": (("seeds", "deterministic"),),
    "horizon": (("schedule", "horizon"),),
    "reward": (("rewards",),),
    "endings": (("endings",),),
    "symmetric": (("roles", "*", "symmetric"),),
}
"""Where a contract declares what stands under a key of `measured`; `*`: by each name."""
BY_AGENT: Final = "by_agent"
LEFT_OUT: Final = ("positive", "negative")
"""Figures by agent that only the JSON document has."""
SPOKEN: Final = {
    "most_in_a_round": "most in a round",
    "fewest_in_a_round": "fewest",
    "zero_sum": "zero-sum",
    "after_end": "after the end",
}
"""Keys that are said otherwise than they are written; names of agents and roles stay."""
SIGNS: Final = {"observation": "o", "reward": "r", "ending": "e"}
MOST_AGENTS: Final = 8
"""Agents of whom a matrix is shown."""
MOST_COLUMNS: Final = 150
"""Characters of one value in the table; the JSON document has all of it."""


def measured_text(audit: Document, *, width: int) -> str:
    """Measured beside declared, agent by agent, who moves whom, which API fits; empty if nothing.

    Args:
        audit: the audit's document.
        width: columns that no line exceeds, as far as names allow.
    """
    measured, declared = audit["measured"], audit.get("declared") or {}
    rows = [
        (
            key.replace("_", " "),
            words(value) or "not seen",
            words(declared_as(declared, key)) or "not declared",
        )
        for key, value in measured.items()
        if key not in APART
    ]
    parts = []
    if rows:
        head = ("", "measured", "declared")
        parts.append("\n".join(["Measured beside declared", *_three([head, *rows], width)]))
    parts += [agents_text(measured, width=width)]
    parts += [influence_text(measured.get("influence") or (), width=width)]
    if measured.get("advice"):
        api = {"aec": "AEC", "parallel": "Parallel"}.get(measured["advice"], measured["advice"])
        why = one_line(f"{api}: {measured.get('why', '')}".removesuffix(": "))
        parts.append("\n".join(["Advice", *wrapped(why, width, first=INDENT, rest=INDENT)]))
    return "\n\n".join(filter(None, parts))


def agents_text(measured: Document, *, width: int) -> str:
    """What was measured of each agent: a row for each of the first ones; empty if nothing was."""
    tables = [each[BY_AGENT] for each in measured.values()
              if isinstance(each, Mapping) and isinstance(each.get(BY_AGENT), Mapping)]  # fmt: skip
    agents = list(dict.fromkeys(name for table in tables for name in table))
    fields = dict.fromkeys(key for table in tables for row in table.values() for key in row)
    shown = [key for key in fields if key not in LEFT_OUT]
    if not shown:
        return ""
    merged = {name: {k: v for table in tables for k, v in table.get(name, {}).items()}
              for name in agents[:MOST_AGENTS]}  # fmt: skip
    rows = [("agent", *(key.replace("_", " ") for key in shown))]
    rows += [(name, *(words(row.get(key)) for key in shown)) for name, row in merged.items()]
    right = range(1, len(shown) + 1)
    lines = list(table_lines(rows, width=max(width, 60), right=right))
    if len(agents) > MOST_AGENTS:
        lines.append(f"{INDENT}... and {len(agents) - MOST_AGENTS} more agents")
    return "\n".join(["Measured by agent", *lines])


def declared_as(declared: Document, key: str) -> Any:
    """What the contract declares of a measured key; None where it says nothing."""
    found = {path[-1]: _at(declared, path) for path in DECLARED.get(key, ())}
    told = {name: value for name, value in found.items() if value not in (None, {})}
    if not told:
        return None
    return next(iter(told.values())) if len(DECLARED[key]) == 1 else told


def _at(declared: Any, path: Sequence[str]) -> Any:
    for place, key in enumerate(path):
        if not isinstance(declared, Mapping):
            return None
        if key == "*":
            inner = {name: _at(each, path[place + 1 :]) for name, each in declared.items()}
            return {name: value for name, value in inner.items() if value is not None}
        declared = declared.get(key)
    return declared


def words(value: Any) -> str:
    """A measured or declared value as a reader would say it; what is told elsewhere is left out."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Mapping):
        if "seems" in value:
            return f"{'seems so' if value['seems'] else 'seems not'}, p {words(value.get('p'))}"
        inner = [_pair(str(name), each) for name, each in value.items() if name != BY_AGENT]
        return "; ".join(filter(None, inner))
    if isinstance(value, list | tuple):
        return ", ".join(filter(None, map(_inner, value)))
    return one_line(str(value))


def _pair(name: str, value: Any) -> str:
    """A name and its value; of a declared term or ending its kind is enough."""
    if isinstance(value, Mapping) and isinstance(value.get("kind"), str):
        return f"{name} ({value['kind']})"
    text = _inner(value)
    return f"{SPOKEN.get(name, name)}: {text}" if text else ""


def _inner(value: Any) -> str:
    text = words(value)
    is_nested = isinstance(value, Mapping | list | tuple)
    return f"({text})" if is_nested and text else text


def _cut(text: str) -> str:
    return text if len(text) <= MOST_COLUMNS else f"{text[:MOST_COLUMNS]}..."


def _three(rows: Sequence[tuple[str, str, str]], width: int) -> list[str]:
    """Three columns, the second and third broken where they don't fit."""
    first = max(columns_of(row[0]) for row in rows)
    room = width - len(INDENT) - first - 4
    second = min(max(columns_of(_cut(row[1])) for row in rows), max(room * 2 // 3, 16))
    lines = []
    for name, measured, declared in rows:
        left = wrapped(_cut(measured), second) or [""]
        right = wrapped(_cut(declared), max(room - second, 12)) or [""]
        for place in range(max(len(left), len(right))):
            cells = (
                filled(name if place == 0 else "", first),
                filled(left[place] if place < len(left) else "", second),
                right[place] if place < len(right) else "",
            )
            lines.append((INDENT + "  ".join(cells)).rstrip())
    return lines


def influence_text(influence: Iterable[Document], *, width: int) -> str:
    """Who moves whom: a matrix of per cents, the strongest lag of each kind; empty if unknown."""
    cells: dict[tuple[str, str], dict[str, Document]] = {}
    for each in influence:
        kinds = cells.setdefault((each["from"], each["to"]), {})
        if each["p"] > 0 and each["p"] > kinds.get(each["on"], {"p": 0.0})["p"]:
            kinds[each["on"]] = each
    if not cells:
        return ""
    agents = list(dict.fromkeys(name for pair in cells for name in pair))
    if len(agents) > MOST_AGENTS:
        return "\n".join(["Influence", *_counted(cells, len(agents), width)])
    rows = [("from \\ to", *agents)]
    rows += [(one, *(_cell(cells.get((one, two), {})) for two in agents)) for one in agents]
    legend = (
        "o, r, e: per cent of replaced actions that changed the observation, reward or ending; "
        "+1: a step later, and so on."
    )
    return "\n".join(
        ["Influence", *table_lines(rows, width=max(width, 60)),
         *wrapped(legend, width, first=INDENT, rest=INDENT)]
    )  # fmt: skip


def _cell(kinds: Mapping[str, Document]) -> str:
    parts = [
        f"{sign}{100 * kinds[on]['p']:.0f}" + (f"+{kinds[on]['lag']}" if kinds[on]["lag"] else "")
        for on, sign in SIGNS.items()
        if on in kinds
    ]
    return " ".join(parts) or "-"


def _counted(
    cells: Mapping[tuple[str, str], Mapping[str, Document]], agents: int, width: int
) -> list[str]:
    rows = []
    for on in SIGNS:
        others = [pair for pair, kinds in cells.items() if on in kinds and pair[0] != pair[1]]
        own = [pair for pair, kinds in cells.items() if on in kinds and pair[0] == pair[1]]
        rows.append((on, f"moved by another agent in {len(others)} pairs, by the own action in "
                     f"{len(own)} of {agents} agents"))  # fmt: skip
    return list(table_lines(rows, width=width))
