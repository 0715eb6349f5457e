"""Differences between a bad run and a good one as text: the least set first, then all of them."""

from collections.abc import Mapping
from typing import Any, Final

from gamekeeper.contract.validation import one_line
from gamekeeper.reporting.results_text import table_lines
from gamekeeper.reporting.text_columns import INDENT, item_lines, wrapped
from gamekeeper.statistics.significance import p_text

LONGEST: Final = 28
"""Characters of a value in the table; the document has all of it."""
HEAD: Final = ("difference", "bad", "good", "alone closes")


def differences_text(document: Mapping[str, Any], *, width: int) -> str:
    """The least set with its effect, the gap, and a table of all differences."""
    found = document["differences"]
    lines = wrapped(f"{found['why']}.", width, first="Answer  ", rest=INDENT)
    for each in found["tested"]:
        if each["restores"]:
            text = f"{each['intervention']}: {effect_text(each)}, {p_text(each['p'])}"
            lines += item_lines(text, width)
    lines += item_lines(_gap(found), width)
    blocks = ["\n".join(lines)]
    if found["listed"]:
        rows = [HEAD, *(_row(each, found["least"]) for each in found["listed"])]
        table = [INDENT + line for line in table_lines(rows, width=width - len(INDENT))]
        blocks.append("\n".join(["Differences", *table]))
    commands = [each["command"] for each in found["listed"] if each["command"]]
    if commands:
        title = "Versions that differ aren't swapped; these commands try them"
        blocks.append("\n".join([title, *(INDENT + command for command in commands)]))
    return "\n\n".join(blocks)


def _gap(found: Mapping[str, Any]) -> str:
    gap, means = found["gap"], found["means"]
    what = "Success rate" if found["measure"] == "success" else "Mean return of the team"
    shown = "{:.0%}" if found["measure"] == "success" else "{:.4g}"
    return (
        f"{what} on paired fresh seeds: {shown.format(means['bad'])} as in the bad run, "
        f"{shown.format(means['good'])} as in {found['good']}; gap {gap['value']:+.2f} "
        f"(95 % interval {gap['low']:+.2f} to {gap['high']:+.2f}); {found['tried']} sets of "
        "differences tried."
    )


def effect_text(each: Mapping[str, Any]) -> str:
    """Formats `+0.52 (+0.31 to +0.73)`."""
    return f"{each['effect']:+.2f} ({each['low']:+.2f} to {each['high']:+.2f})"


def _row(each: Mapping[str, Any], least: Any) -> tuple[str, str, str, str]:
    """Name with a star where it is in a least set, both values, and the part that it closes."""
    star = "* " if any(each["name"] in names for names in least) else "  "
    alone = "not swapped" if each["kind"] == "version" else ""
    if each.get("alone") is not None:
        alone = f"{each['alone']:.0%} of the gap"
    return star + one_line(each["name"]), _cut(each["bad"]), _cut(each["good"]), alone


def _cut(value: Any) -> str:
    """The end of a long value: paths differ there."""
    text = one_line("none" if value is None else str(value))
    return text if len(text) <= LONGEST else f"...{text[3 - LONGEST :]}"
