"""What of a run still holds, as text: what has changed first, then what must be measured again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.core.contract.places import one_line
from gamekeeper.report.columns import wrapped
from gamekeeper.report.text import table_lines

INDENT: Final = "  "
LONGEST: Final = 19
"""Signs of a value beside its pair; a digest's first ones tell it apart, the document has all."""
HEAD: Final = ("", "recorded", "now")


def against_text(document: Mapping[str, Any], *, width: int) -> str:
    """The verdict on the first line, then rows by status, then what to measure again.

    Args:
        document: as `Against.to_json` gives it.
        width: columns that no line exceeds, as far as names allow.
    """
    rows: Sequence[Mapping[str, Any]] = document["rows"]
    by = {status: [row for row in rows if row["status"] == status]
          for status in ("stale", "unknown", "holds")}  # fmt: skip
    blocks = [_verdict(document, by, width)]
    for status, title in (("stale", "Stale"), ("unknown", "Can't be told")):
        if by[status]:
            table = table_lines([HEAD, *map(_cells, by[status])], width=width)
            blocks.append("\n".join([title, *table]))
    if by["holds"]:
        names = ", ".join(one_line(row["what"]) for row in by["holds"])
        blocks.append("\n".join(["Holds", *wrapped(names, width, first=INDENT, rest=INDENT)]))
    worst = by[document["status"]] if document["status"] != "holds" else []
    again = dict.fromkeys(row["again"] for row in worst if row["again"])
    if again:
        lines = [line for text in again for line in wrapped(text, width, first=INDENT, rest="    ")]
        blocks.append("\n".join(["To be measured again", *lines]))
    return "\n\n".join(blocks)


def _verdict(document: Mapping[str, Any], by: Mapping[str, Sequence[Any]], width: int) -> str:
    count = f"{len(by['stale'])} of {len(document['rows'])}"
    told = {
        "holds": "holds: nothing that it hangs on has changed",
        "stale": f"stale: {count} things that it hangs on have changed",
        "unknown": f"can't tell: {len(by['unknown'])} of {len(document['rows'])} things that it "
        "hangs on may have changed",
    }[document["status"]]
    place = f"{told} ({document['run']} against {document['against']})"
    return "\n".join(wrapped(one_line(place), width, rest=INDENT))


def _cells(row: Mapping[str, Any]) -> tuple[str, str, str]:
    recorded, now = (one_line(row[side] or "none") for side in ("recorded", "now"))
    return one_line(row["what"]), _cut(recorded), now if " " in now else _cut(now)


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
