"""What changed in a game between two versions of an environment, as plain text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.core.contract.places import one_line
from gamekeeper.report.measured_text import words
from gamekeeper.report.text import table_lines

Change = Mapping[str, Any]

TITLES: Final = {
    "api": "API",
    "roster": "Roster",
    "spaces": "Spaces",
    "contract": "Declared",
    "measured": "Measured",
    "verdicts": "Promises",
}
MOST_ROWS: Final = 12
"""Changes of one kind that are shown; the JSON document has all of them."""
MOST_SIGNS: Final = 160
"""Characters of a value that are shown."""


def changes_text(changes: Sequence[Change], *, width: int) -> str:
    """The changes by kind: what it is, and what it was and is now; empty where there are none."""
    blocks = []
    for kind, title in TITLES.items():
        found = [each for each in changes if each["kind"] == kind]
        rows = [(each["where"], f"{_value(each['a'])} -> {_value(each['b'])}")
                for each in found[:MOST_ROWS] if kind != "verdicts"]  # fmt: skip
        if kind == "verdicts":
            rows = [(f"{_value(x['a'])} -> {_value(x['b'])}", x["where"]) for x in _worst(found)]
        if len(found) > MOST_ROWS:
            rows.append(("...", f"and {len(found) - MOST_ROWS} more"))
        if rows:
            blocks.append("\n".join([title, *table_lines(rows, width=width)]))
    return "\n\n".join(blocks)


def _worst(changes: Sequence[Change]) -> list[Change]:
    """What broke first, then what was mended, then the rest."""
    order = ("broken", "error", "waived")

    def rank(each: Change) -> tuple[int, int]:
        after = order.index(each["b"]) if each["b"] in order else len(order)
        return after, 0 if each["a"] == "broken" else 1

    return sorted(changes, key=rank)[:MOST_ROWS]


def _value(value: Any) -> str:
    text = one_line(words(value)).replace("not_applicable", "not applicable") or "nothing"
    return text if len(text) <= MOST_SIGNS else f"{text[:MOST_SIGNS]}..."
