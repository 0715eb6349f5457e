"""Verdicts of an audit by severity, each finding with the program that shows it again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gamekeeper.core.verdict import SEVERITIES
from gamekeeper.report.page.data import Cell, Finding, Judged, Section, Verdicts, badge

ORDER: Final = ("waived", "unseen", "kept", "not_applicable")
"""The outcomes that are no fault, in the order in which they are told."""
BAD: Final = ("broken", "error")
FACTS: Final = ("where", "expected", "seen", "mend")


def verdicts_section(audit: Mapping[str, Any] | None) -> Section:
    """What every check came to; without an audit, how to have one.

    Args:
        audit: the document of `gamekeeper audit --json`.
    """
    title = "Verdicts"
    if audit is None:
        return Section(
            "verdicts",
            title,
            missing="No audit was given. `gamekeeper audit ENV --json > audit.json`, then "
            "`gamekeeper report RUN --audit audit.json`.",
        )
    judged = [_judged(each) for each in audit["verdicts"] if isinstance(each, Mapping)]
    bad = sorted((each for each in judged if each.outcome in BAD), key=_weight)
    rest = tuple(
        (outcome.replace("_", " "), tuple(each for each in judged if each.outcome == outcome))
        for outcome in ORDER
    )
    notes = (
        f"{audit.get('environment')}, {audit.get('steps')} steps, seed {audit.get('seed')}.",
        "Unseen: nothing that was played gave an occasion to look. It is no promise kept.",
    )
    found = Verdicts(_summary(judged), tuple(bad), tuple((o, each) for o, each in rest if each),
                     notes)  # fmt: skip
    return Section("verdicts", title, verdicts=found)


def _summary(judged: Sequence[Judged]) -> tuple[Cell, ...]:
    counts = dict.fromkeys((*BAD, *ORDER), 0)
    for each in judged:
        counts[each.outcome] = counts.get(each.outcome, 0) + 1
    return tuple(
        badge(f"{count} {outcome.replace('_', ' ')}", outcome)
        for outcome, count in counts.items()
        if count
    )


def _weight(judged: Judged) -> tuple[int, int, str]:
    place = SEVERITIES.index(judged.severity) if judged.severity in SEVERITIES else len(SEVERITIES)
    return (BAD.index(judged.outcome), place, judged.id)


def _judged(verdict: Mapping[str, Any]) -> Judged:
    id = str(verdict.get("id"))  # the word that everybody uses for it
    looks = f"looked {verdict.get('occasions', 0):,} times"
    if verdict.get("broken"):
        looks += f", broken {verdict['broken']:,} times"
    return Judged(
        id=id,
        claim=str(verdict.get("claim", "")),
        outcome=str(verdict.get("outcome")),
        severity=str(verdict.get("severity", "")),
        reason=str(verdict.get("reason") or ""),
        looks=looks,
        findings=tuple(
            Finding(
                facts=tuple((key, str(each[key])) for key in FACTS if each.get(key)),
                program=str(each.get("reproduce") or ""),
                anchor=f"program-{place}-{k}",
            )
            for place in [_anchor(id)]
            for k, each in enumerate(verdict.get("findings") or ())
        ),
    )


def _anchor(text: str) -> str:
    """A name as an address: letters and digits of it alone."""
    return "".join(sign for sign in text if sign.isascii() and sign.isalnum())
