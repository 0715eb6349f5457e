"""What an audit came to, as plain text: the worst first, little to read where all is well.

All functions take the audit's document, as `gamekeeper audit --json` prints it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.core.contract.places import one_line
from gamekeeper.core.verdict import SEVERITIES
from gamekeeper.report.columns import wrapped
from gamekeeper.report.text import table_lines

Document = Mapping[str, Any]
Row = tuple[str, str]

INDENT: Final = "  "
OUTCOMES: Final = ("broken", "error", "waived", "unseen", "not_applicable", "kept")
"""The outcomes of verdicts in the order in which they are told."""
SURE: Final = 0.995
"""A confidence from here on is not worth a word."""
MOST_SHOWN: Final = 400
"""Characters of a value that a finding shows; the JSON document has all of it."""


def verdicts_of(audit: Document, *outcomes: str) -> list[Document]:
    """The verdicts with these outcomes: the worst first, then by id."""
    found = [each for each in audit["verdicts"] if each["outcome"] in outcomes]
    return sorted(found, key=lambda each: (SEVERITIES.index(each["severity"]), each["id"]))


def title_text(audit: Document) -> str:
    """The environment and what the audit came to, in one line."""
    api = {"aec": "AEC", "parallel": "Parallel"}.get(audit["api"], audit["api"])
    return f"{one_line(audit['environment'])} ({api}): {counts_text(audit)}"


def counts_text(audit: Document) -> str:
    """`2 broken (1 high, 1 low), 1 waived, 3 unseen, 12 not applicable, 41 kept`."""
    parts = []
    for outcome in OUTCOMES:
        found = verdicts_of(audit, outcome)
        if not found:
            continue
        part = f"{len(found)} {outcome.replace('_', ' ')}"
        if outcome == "broken":
            by = [(sum(each["severity"] == name for each in found), name) for name in SEVERITIES]
            part += f" ({', '.join(f'{count} {name}' for count, name in by if count)})"
        parts.append(part)
    return ", ".join(parts) or "no check was asked"


def broken_blocks(audit: Document, *, width: int, least: str = "low") -> Iterator[tuple[str, str]]:
    """The broken promises by severity: a heading, and the findings below it.

    Args:
        audit: the document.
        width: columns that no line exceeds, as far as words allow.
        least: severity below which nothing is shown.
    """
    for severity in SEVERITIES[: SEVERITIES.index(least) + 1]:
        found = [x for x in verdicts_of(audit, "broken") if x["severity"] == severity]
        if found:
            yield f"Broken: {severity}", "\n\n".join(_finding(each, width) for each in found)


def brief_rows(audit: Document, *, most: int) -> list[tuple[str, str, str]]:
    """Id, severity and claim of the worst broken promises, and how many more there are."""
    found = verdicts_of(audit, "broken")
    rows = [(each["id"], each["severity"], _short(each["claim"])) for each in found[:most]]
    return rows if len(found) <= most else [*rows, ("", "", f"and {len(found) - most} more")]


def _finding(verdict: Document, width: int) -> str:
    """One broken promise: the claim, the first place in full, the others named."""
    lines = _claim(verdict, width)
    first, *others = verdict["findings"] or [{}]
    rows = [(name, _short(first.get(name, ""))) for name in ("where", "expected", "seen", "mend")]
    rows += [("also", _short(f"{x['where']}: seen {x['seen']}")) for x in others]
    rows.append(("broken", _looks(verdict)))
    told = table_lines([row for row in rows if row[1]], width=width - len(INDENT))
    return "\n".join([*lines, *(f"{INDENT}{line}" for line in told)])


def _claim(verdict: Document, width: int) -> list[str]:
    start = f"{INDENT}{verdict['id']}  "
    text = one_line(verdict["claim"])
    return wrapped(text, width, first=start, rest=" " * len(start)) or [start.rstrip()]


def _looks(verdict: Document) -> str:
    told = f"{verdict['broken']:,} of {verdict['occasions']:,} looks"
    sure = verdict["confidence"]
    return told if sure >= SURE else f"{told}, confidence {sure:.2f}"


def _short(text: str) -> str:
    line = one_line(text)
    return line if len(line) <= MOST_SHOWN else f"{line[:MOST_SHOWN]}..."


def program_of(audit: Document) -> tuple[str, str] | None:
    """Id and program of the worst finding that has one."""
    for verdict in verdicts_of(audit, "broken"):
        for finding in verdict["findings"]:
            if finding["reproduce"]:
                return verdict["id"], finding["reproduce"]
    return None


def waived_text(audit: Document, *, known: Collection[str], width: int) -> str:
    """Waived promises with their reasons, and waivers that nothing needs any more.

    Args:
        audit: the document.
        known: the ids of all checks there are.
        width: columns that no line exceeds, as far as words allow.
    """
    rows = [(x["id"], f"{_short(x['claim'])} Waived: {_short(x['reason'])}")
            for x in verdicts_of(audit, "waived")]  # fmt: skip
    rows += [(x["id"], _short(x["reason"])) for x in verdicts_of(audit, "kept") if x["reason"]]
    waivers = (audit.get("declared") or {}).get("waivers", {})
    rows += [(id, "there is no such check to waive") for id in waivers if id not in known]
    return _section("Waivers", rows, width)


def unseen_text(audit: Document, *, width: int) -> str:
    """Checks that had no occasion to look, by the reason."""
    by_reason: dict[str, list[str]] = {}
    for each in verdicts_of(audit, "unseen"):
        by_reason.setdefault(_short(each["reason"]), []).append(each["id"])
    rows = [(str(len(ids)), f"{reason}: {', '.join(ids)}") for reason, ids in by_reason.items()]
    return _section("Unseen", rows, width)


def errors_text(audit: Document, *, width: int) -> str:
    """Checks that failed themselves, with the last line of what they raised."""
    rows = [(each["id"], _short((each["reason"].strip().splitlines() or [""])[-1]))
            for each in verdicts_of(audit, "error")]  # fmt: skip
    return _section("Checks that failed themselves", rows, width)


def timings_text(audit: Document, *, width: int) -> str:
    """Seconds by probe, the longest first, and steps of the environment."""
    timed = sorted(audit["timings"].items(), key=lambda pair: -pair[1])
    rows = [(name, f"{seconds:8.2f} s") for name, seconds in timed]
    rows.append(("in all", f"{audit['seconds']:8.2f} s, {audit['steps']:,} steps"))
    return _section("Timings", rows, width)


def _section(title: str, rows: Sequence[Row], width: int) -> str:
    """A heading and its rows; nothing where there are none."""
    return "\n".join([title, *table_lines(rows, width=width)]) if rows else ""
