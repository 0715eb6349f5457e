"""Several audits at a glance: what is broken, and in how many of an environment's seeds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gamekeeper.core.contract.places import one_line
from gamekeeper.core.verdict import SEVERITIES
from gamekeeper.report.audit_text import INDENT, verdicts_of
from gamekeeper.report.columns import wrapped
from gamekeeper.report.text import table_lines

Document = Mapping[str, Any]


def audits_text(documents: Sequence[Document], *, width: int) -> Iterator[tuple[str, str, str]]:
    """For each environment its title, how it stands (`good`, `bad`, `unsure`), and its findings.

    Args:
        documents: of audits, or `environment`, `seed` and `error` of one that couldn't be made.
        width: columns that no line exceeds, as far as words allow.
    """
    for environment in dict.fromkeys(each["environment"] for each in documents):
        theirs = [each for each in documents if each["environment"] == environment]
        audited = [each for each in theirs if "verdicts" in each]
        failed = [each for each in theirs if "verdicts" not in each]
        rows = [*_broken_rows(audited), *_error_rows(failed)]
        broken = sum(1 for row in rows if row[0] != "error")
        told = [f"{one_line(environment)}: {_counted(len(theirs), 'seed')}"]
        if audited:
            told.append(f"{_counted(broken, 'promise')} broken" if broken else "nothing broken")
        if failed:
            told.append(f"{len(failed)} not audited" if audited else "not audited")
        title = ", ".join(told)
        manner = "bad" if broken else "unsure" if failed or not audited else "good"
        yield title, manner, "\n".join(table_lines(rows, width=width) if rows else ())


def unseen_somewhere(documents: Sequence[Document], *, width: int) -> str:
    """The checks that no seed of an environment gave an occasion to look; empty without any."""
    lines = []
    for environment in dict.fromkeys(each["environment"] for each in documents):
        theirs = [x for x in documents if x["environment"] == environment and "verdicts" in x]
        unseen = [{x["id"] for x in verdicts_of(each, "unseen")} for each in theirs]
        ids = sorted(set.intersection(*unseen)) if unseen else []
        if ids:
            told = f"Unseen in every seed of {one_line(environment)}: {', '.join(ids)}"
            lines += wrapped(told, width, first="", rest=INDENT)
    return "\n".join(lines)


def _broken_rows(audits: Sequence[Document]) -> list[tuple[str, str, str, str]]:
    """Id, severity, seeds and claim of what is broken in any of them, the worst first."""
    found: dict[str, tuple[Document, list[int]]] = {}
    for audit in audits:
        for verdict in verdicts_of(audit, "broken"):
            found.setdefault(verdict["id"], (verdict, []))[1].append(audit["seed"])
    ranked = sorted(
        found.values(), key=lambda each: (SEVERITIES.index(each[0]["severity"]), each[0]["id"])
    )
    return [
        (verdict["id"], verdict["severity"], _seeds(seeds, len(audits)), one_line(verdict["claim"]))
        for verdict, seeds in ranked
    ]


def _error_rows(failed: Sequence[Document]) -> list[tuple[str, str, str, str]]:
    """What was in the way, with the seeds in which it was."""
    found: dict[tuple[str, str], list[int]] = {}
    for each in failed:
        error = each["error"]
        found.setdefault((error["kind"], one_line(error["what"])), []).append(each["seed"])
    return [
        ("error", kind, _seeds(seeds, len(seeds)), what) for (kind, what), seeds in found.items()
    ]


def _seeds(seeds: Sequence[int], of: int) -> str:
    if len(seeds) == of > 1:
        return f"all {of} seeds"
    named = ", ".join(map(str, seeds[:6])) + (", ..." if len(seeds) > 6 else "")
    return f"seed {named}" if len(seeds) == 1 else f"{len(seeds)} of {of} seeds: {named}"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
