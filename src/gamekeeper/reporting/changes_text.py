"""Changes of a game between two versions of an environment, as plain text."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.contract.validation import one_line
from gamekeeper.reporting.measured_text import words
from gamekeeper.reporting.results_text import table_text
from gamekeeper.reporting.text_columns import INDENT, block_text, indented, items_text, wrapped

Change = Mapping[str, Any]

TITLES: Final = {
    "api": "API",
    "roster": "Agents",
    "spaces": "Spaces",
    "contract": "Declared",
    "measured": "Measured",
    "verdicts": "Checks",
}
MOST_ROWS: Final = 12
"""Changes of one kind that are shown; the JSON document has all of them."""
MOST_SIGNS: Final = 160
"""Characters of a value that are shown."""


def changes_text(changes: Sequence[Change], *, width: int) -> str:
    """The changes by kind, each with both values; empty where there are none."""
    blocks = []
    for kind, title in TITLES.items():
        found = [each for each in changes if each["kind"] == kind]
        rows = [
            (each["where"], f"{_value(each['a'])} -> {_value(each['b'])}")
            for each in found[:MOST_ROWS]
            if kind != "verdicts"
        ]
        if kind == "verdicts":
            rows = [(f"{_value(x['a'])} -> {_value(x['b'])}", x["where"]) for x in _worst(found)]
        if len(found) > MOST_ROWS:
            rows.append(("...", f"and {len(found) - MOST_ROWS} more"))
        blocks.append(table_text(title, rows, width))
    return "\n\n".join(filter(None, blocks))


def _worst(changes: Sequence[Change]) -> list[Change]:
    """Checks that fail now first, then those that failed before, then the rest."""
    order = ("failed", "error", "waived")

    def rank(each: Change) -> tuple[int, int]:
        after = order.index(each["b"]) if each["b"] in order else len(order)
        return after, 0 if each["a"] == "failed" else 1

    return sorted(changes, key=rank)[:MOST_ROWS]


def _value(value: Any) -> str:
    text = one_line(words(value)).replace("not_applicable", "not applicable")
    text = text.replace("not_exercised", "not exercised") or "not there"
    return text if len(text) <= MOST_SIGNS else f"{text[:MOST_SIGNS]}..."


LONGEST: Final = 19
"""Characters of a value beside its pair: enough of a digest; the document has all of it."""
HEAD: Final = ("", "recorded", "now")


def against_text(document: Mapping[str, Any], *, width: int) -> str:
    """The verdict on the first line, then rows by status, then results to measure again.

    Args:
        document: as `Against.to_json` gives it.
    """
    rows: Sequence[Mapping[str, Any]] = document["rows"]
    by = {
        status: [row for row in rows if row["status"] == status]
        for status in ("stale", "unknown", "holds")
    }
    blocks = [_verdict(document, by, width)]
    for status, title in (("stale", "Stale"), ("unknown", "Unknown")):
        if by[status]:
            blocks.append(table_text(title, [HEAD, *map(_cells, by[status])], width))
    names = ", ".join(one_line(row["what"]) for row in by["holds"])
    blocks.append(block_text("Holds", indented(names, width)))
    worst = by[document["status"]] if document["status"] != "holds" else []
    again = dict.fromkeys(row["again"] for row in worst if row["again"])
    blocks.append(items_text("To be measured again", again, width))
    return "\n\n".join(filter(None, blocks))


def _verdict(document: Mapping[str, Any], by: Mapping[str, Sequence[Any]], width: int) -> str:
    count = f"{len(by['stale'])} of {len(document['rows'])}"
    verdict = {
        "holds": "holds: its environment and policies are unchanged",
        "stale": f"stale: {count} parts that its results depend on have changed",
        "unknown": f"unknown: {len(by['unknown'])} of {len(document['rows'])} parts that its "
        "results depend on may have changed",
    }[document["status"]]
    text = f"{verdict} ({document['run']} against {document['against']})"
    return "\n".join(wrapped(one_line(text), width, rest=INDENT))


def _cells(row: Mapping[str, Any]) -> tuple[str, str, str]:
    recorded, now = (one_line(row[side] or "none") for side in ("recorded", "now"))
    return one_line(row["what"]), _cut(recorded), now if " " in now else _cut(now)


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
