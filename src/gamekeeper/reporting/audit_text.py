"""Result of an audit as plain text: the worst first, little to read where all is well.

All functions take the audit's document, as `gamekeeper audit --json` prints it.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Final

from gamekeeper.checks.verdict import LOW, MINOR, NO_CASE, SEVERITIES
from gamekeeper.contract.validation import one_line
from gamekeeper.reporting.results_text import table_lines, table_text
from gamekeeper.reporting.text_columns import INDENT, columns_of, indented, items_text, wrapped

Document = Mapping[str, Any]
Row = tuple[str, str]

OUTCOMES: Final = (
    "passed",
    "waived",
    "not_exercised",
    "not_applicable",
    "error",
    "suspected",
    "failed",
)
"""Outcomes of verdicts in the order in which they are counted."""
SURE: Final = 0.995
"""Confidence from which on it isn't shown."""
LARGE_SHARE: Final = 0.1
"""Share of cases from which on it is told that a fault in fewer could have been missed."""
NEEDS: Final = "Not exercised ({count}), as no episode had"
REASONS: Final = "Not exercised ({count})"
RERUNS: Final = "it needs reruns"
"""Beginning of the reason for which a recorded run leaves most checks not exercised."""
MOST_SHOWN: Final = 400
"""Characters of a value that a finding shows; the JSON document has all of it."""


def verdicts_of(audit: Document, *outcomes: str) -> list[Document]:
    """The verdicts with these outcomes: the worst first, then by id."""
    found = [each for each in audit["verdicts"] if each["outcome"] in outcomes]
    return sorted(found, key=lambda each: (SEVERITIES.index(each["severity"]), each["id"]))


def title_text(audit: Document, *, width: int) -> str:
    """The environment and the result of its audit, in one line where it fits."""
    api = {"aec": " (AEC)", "parallel": " (Parallel)"}.get(audit["api"], "")
    name, counts = f"{one_line(audit['environment'])}{api}:", counts_text(audit)
    if columns_of(name) + columns_of(counts) < width:
        return f"{name} {counts}"
    return "\n".join([name, *indented(counts, width)])


def counts_text(audit: Document) -> str:
    """`41 passed, 1 waived, 3 not exercised, 12 not applicable, 2 failed (1 high, 1 low)`."""
    counts = [(len(verdicts_of(audit, outcome)), outcome) for outcome in OUTCOMES]
    failed = [each["severity"] for each in verdicts_of(audit, "failed")]
    severities = ", ".join(f"{failed.count(x)} {x}" for x in SEVERITIES if x in failed)
    text = ", ".join(
        f"{count} {outcome.replace('_', ' ')}"
        for count, outcome in counts
        if count or outcome in ("passed", "failed")
    )
    return f"{text} ({severities})" if severities else text


def failed_blocks(audit: Document, *, width: int) -> Iterator[tuple[str, str]]:
    """The failed checks: causes by severity, in full; consequences and minor ones in a line each.

    A cause stands where the worst of what follows from it would.

    """
    failed = verdicts_of(audit, "failed")
    causes = [each for each in failed if not each["follows_from"]]
    for severity in SEVERITIES:
        found = [each for each in causes if _worst(each, failed) == severity]
        if found and severity == LOW:
            rows = [_minor(each) for each in found]
            yield "Failed: low severity", "\n".join(table_lines(rows, width=width))
        elif found:
            yield (
                f"Failed: {severity} severity",
                "\n\n".join(_finding(each, width) for each in found),
            )
    follow = [each for each in failed if each["follows_from"]]
    rows = [_consequence(each) for each in follow]
    if rows:
        yield "Failed: consequences of these", "\n".join(table_lines(rows, width=width))


def _worst(cause: Document, failed: Sequence[Document]) -> str:
    """The worst severity among a cause and what follows from it."""
    group = [each for each in failed if (each["follows_from"] or {}).get("id") == cause["id"]]
    return SEVERITIES[min(SEVERITIES.index(each["severity"]) for each in (cause, *group))]


def _minor(verdict: Document) -> Row:
    """A cause of low severity in one line."""
    first = (verdict["findings"] or [{}])[0]
    facts = finding_facts(first)
    at = f" (at {facts['lines']})" if "lines" in facts else ""
    return verdict["id"], _short(f"{broken_rule(verdict)} Actual: {facts.get('actual', '')}{at}")


def _consequence(verdict: Document) -> Row:
    """The broken rule, the cause, and what was held still so that the reproducer passed."""
    cause = verdict["follows_from"]
    held = cause["held_still"]
    why = f"with {held}, it passes" if held else "both end in the same exception"
    text = f"{broken_rule(verdict)} Follows from {cause['id']}: {why}."
    return verdict["id"], _short(text)


def rows_text(verdicts: Sequence[Document], run: str, *, width: int) -> str:
    """Rules that a run's rows break, each with its first place, and the command that says more."""
    rows = [
        (each["id"], _short(f"{broken_rule(each)} First failed at {each['findings'][0]['where']}."))
        for each in verdicts
    ]
    rows.append(("", f"(gamekeeper audit {run} says more)"))
    return table_text("Rules that the recorded rows break", rows, width)


def masked_text(masked: Mapping[str, tuple[int, int]], *, width: int) -> str:
    """Actions that the mask forbids, by agent; empty where there are none."""
    rows = [(name, f"{count:,} of {of:,}") for name, (count, of) in masked.items()]
    return table_text("Actions that their mask forbids (of the policies)", rows, width)


def outside_text(
    outside: Mapping[str, tuple[int, int, str]], *, width: int, of_audit: bool = True
) -> str:
    """Actions out of their space, by agent; empty where there are none.

    Args:
        of_audit: the text is of an audit, which judges no episode with such an action.
    """
    rows = [
        (name, _short(f"{count:,} of {of:,}. First at {place}"))
        for name, (count, of, place) in outside.items()
    ]
    if rows and of_audit:
        rows.append(("", "(episodes with such an action aren't judged)"))
    return table_text("Actions out of their space (of the policies)", rows, width)


def suspected_text(audit: Document, *, width: int) -> str:
    """Checks with a failed case that their reproducer doesn't show: place, value and reason."""
    rows = []
    for each in verdicts_of(audit, "suspected"):
        first = (each["findings"] or [{}])[0]
        seen = f" At {first['where']}: {first['actual']}." if first else ""
        text = f"{broken_rule(each)}{seen} Not confirmed: {each['reason']}."
        rows.append((each["id"], _short(text)))
    return table_text("Suspected (failed, but not confirmed)", rows, width)


def brief_rows(audit: Document, *, most: int) -> list[tuple[str, str, str]]:
    """Id, severity and broken rule of the worst failed checks, causes first; ids of the others."""
    found = sorted(verdicts_of(audit, "failed"), key=lambda each: each["follows_from"] is not None)
    rows = [(each["id"], each["severity"], _short(_brief(each))) for each in found[:most]]
    others = ", ".join(each["id"] for each in found[most:])
    return [*rows, ("", "", f"and {len(found) - most} more: {others}")] if others else rows


def _brief(verdict: Document) -> str:
    """The broken rule, and of a consequence its cause."""
    cause = verdict["follows_from"]
    return broken_rule(verdict) + (f" Follows from {cause['id']}." if cause else "")


def broken_rule(verdict: Document) -> str:
    """The rule of a failed check, worded as what should hold: `Should hold: No agent ...`."""
    return f"Should hold: {verdict.get('claim', '')}"


def finding_facts(finding: Document) -> dict[str, str]:
    """Parts of a finding in words, by their names: where, expected, actual, lines, fix."""
    facts = {**finding, "lines": ", ".join(finding.get("lines") or ())}
    names = "where", "expected", "actual", "lines", "fix"
    return {name: str(facts[name]) for name in names if facts.get(name)}


def _finding(verdict: Document, width: int) -> str:
    """One failed check: the broken rule, the first place in full, the others named."""
    start = f"{INDENT}{verdict['id']}  "
    rule = wrapped(one_line(broken_rule(verdict)), width, first=start, rest=" " * len(start))
    first, *others = verdict["findings"] or [{}]
    rows = [(name, _short(text)) for name, text in finding_facts(first).items()]
    rows += [("also", _short(f"{x['where']}: actual {x['actual']}")) for x in others]
    rows.append(("seen", _cases(verdict)))
    lines = table_lines([row for row in rows if row[1]], width=width - len(INDENT))
    return "\n".join([*rule, *(f"{INDENT}{line}" for line in lines)])


def _cases(verdict: Document) -> str:
    """`failed in 80 of 80 cases; its program failed in 5 of 5 new processes, ...`."""
    text = f"failed in {verdict['failed']:,} of {_counted(verdict['cases'], 'case')}"
    how = verdict["reproduced"]
    if how is not None:
        text += f"; its program failed in {how['failed']} of {how['tried']} new processes"
        text += ", and passed without what triggers the fault" if how["unchanged_passed"] else ""
    confidence = verdict["confidence"]
    return text if confidence >= SURE else f"{text}; confidence {confidence:.2f}"


def _short(text: str) -> str:
    line = one_line(text)
    return line if len(line) <= MOST_SHOWN else f"{line[:MOST_SHOWN]}..."


def program_of(audit: Document) -> tuple[str, str] | None:
    """Id and program of the worst finding that has one, a cause's where there is one.

    Where nothing failed, of a suspected one whose program failed in every process.
    """
    failed = sorted(verdicts_of(audit, "failed"), key=lambda x: x["follows_from"] is not None)
    shown = [x for x in verdicts_of(audit, "suspected") if _is_shown(x["reproduced"])]
    for verdict in (*failed, *shown):
        for finding in verdict["findings"]:
            if finding["reproducer"]:
                return verdict["id"], finding["reproducer"]
    return None


def _is_shown(how: Document | None) -> bool:
    """Tells whether a program failed in every process, and not without its trigger."""
    return (
        how is not None and how["failed"] == how["tried"] and how["unchanged_passed"] is not False
    )


def waived_text(audit: Document, *, known: Collection[str], width: int) -> str:
    """Waived checks with their reasons, and waivers that are no longer needed.

    Args:
        known: ids of all checks.
    """
    rows = [
        (x["id"], f"{_short(broken_rule(x))} Waived: {_short(x['reason'])}")
        for x in verdicts_of(audit, "waived")
    ]
    rows += [(x["id"], _short(x["reason"])) for x in verdicts_of(audit, "passed") if x["reason"]]
    waivers = (audit.get("declared") or {}).get("waivers", {})
    rows += [(id, "a check with this id doesn't exist") for id in waivers if id not in known]
    return table_text("Waivers", rows, width)


def not_exercised_text(audit: Document, *, width: int) -> str:
    """Ids of the checks that were not exercised, by what no episode had or another reason."""
    needs: dict[str, list[str]] = {}
    reasons: dict[str, list[str]] = {}
    reruns = 0
    for each in verdicts_of(audit, "not_exercised"):
        reason = each["reason"]
        reruns += reason.startswith(RERUNS)
        if reason.startswith(f"{NO_CASE}: "):
            needs.setdefault(reason.removeprefix(f"{NO_CASE}: "), []).append(each["id"])
        elif not reason.startswith(RERUNS):
            reasons.setdefault(reason, []).append(each["id"])
    parts: list[str] = []
    for title, found in ((NEEDS, needs), (REASONS, reasons)):
        count = sum(map(len, found.values()))
        rows = [f"{_named(ids, text, audit)}: {_short(text)}" for text, ids in found.items()]
        parts += filter(None, [items_text(title.format(count=count), rows, width)])
    if parts:
        parts[-1] += f"\n{INDENT}gamekeeper explain ID says what a check promises."
    if reruns:
        need = "check needs" if reruns == 1 else "checks need"
        parts.append(f"{reruns} {need} reruns: gamekeeper audit ENV (--json has their ids)")
    return "\n\n".join(parts)


def _named(ids: Sequence[str], reason: str, audit: Document) -> str:
    """Ids of checks; the number of those that the end of the audit alone left out."""
    is_cut = audit["stopped"].startswith(reason)
    return _counted(len(ids), "check") if is_cut else ", ".join(sorted(ids))


def minor_text(audit: Document, *, width: int) -> str:
    """Lists what isn't promised and may be missed, each reason once with its checks."""
    by_reason: dict[str, list[str]] = {}
    for each in verdicts_of(audit, "not_applicable"):
        if each["reason"].startswith(MINOR):
            by_reason.setdefault(_short(each["reason"].removeprefix(MINOR)), []).append(each["id"])
    rows = [(", ".join(ids), reason) for reason, ids in by_reason.items()]
    return table_text("Minor (not promised, not failed)", rows, width)


def chances_text(audit: Document, *, width: int) -> str:
    """Number of passed checks that looked at few places, and what these could have missed."""
    passed = verdicts_of(audit, "passed")
    few = [each for each in passed if (each.get("could_miss") or 0) > LARGE_SHARE]
    if not few:
        return ""
    most = _counted(max(each["cases"] for each in few), "case")
    text = (
        f"Of those passed, {_counted(len(few), 'check')} had {most} or fewer: a fault in 1 case of "
        f"{1 / LARGE_SHARE:.0f} could have been missed (--json: cases, could_miss)"
    )
    return "\n".join(wrapped(text, width, rest=INDENT))


def errors_text(audit: Document, *, width: int) -> str:
    """Checks that raised an exception, with its last line."""
    rows = [
        (each["id"], _short((each["reason"].strip().splitlines() or [""])[-1]))
        for each in verdicts_of(audit, "error")
    ]
    return table_text("Checks with an error", rows, width)


def audits_text(documents: Sequence[Document], *, width: int) -> Iterator[tuple[str, str, str]]:
    """Title, standing (`good`, `bad`, `unsure`) and findings of each environment.

    Args:
        documents: documents of audits, or `environment`, `seed` and `error` of one that failed.
    """
    for environment in dict.fromkeys(each["environment"] for each in documents):
        theirs = [each for each in documents if each["environment"] == environment]
        audited = [each for each in theirs if "verdicts" in each]
        failed = [each for each in theirs if "verdicts" not in each]
        rows = [*_failed_rows(audited), *_error_rows(failed)]
        failed_checks = sum(1 for row in rows if row[0] != "error")
        parts = [f"{one_line(environment)}: {_counted(len(theirs), 'seed')}"]
        if audited:
            count = _counted(failed_checks, "check") if failed_checks else "no check"
            parts.append(f"{count} failed")
        if failed:
            parts.append(f"{len(failed)} not audited" if audited else "not audited")
        manner = "bad" if failed_checks else "unsure" if failed or not audited else "good"
        yield ", ".join(parts), manner, "\n".join(table_lines(rows, width=width))


def not_exercised_somewhere(documents: Sequence[Document], *, width: int) -> str:
    """Checks that were exercised with no seed of an environment; empty if there are none."""
    lines = []
    for environment in dict.fromkeys(each["environment"] for each in documents):
        theirs = [x for x in documents if x["environment"] == environment and "verdicts" in x]
        not_exercised = [{x["id"] for x in verdicts_of(each, "not_exercised")} for each in theirs]
        ids = sorted(set.intersection(*not_exercised)) if not_exercised else []
        if ids:
            text = f"Not exercised with any seed of {one_line(environment)}: {', '.join(ids)}"
            lines += wrapped(text, width, first="", rest=INDENT)
    return "\n".join(lines)


def _failed_rows(audits: Sequence[Document]) -> list[tuple[str, str, str, str]]:
    """Id, severity, seeds and claim of the checks that failed in any audit, the worst first."""
    found: dict[str, tuple[Document, list[int]]] = {}
    for audit in audits:
        for verdict in verdicts_of(audit, "failed"):
            found.setdefault(verdict["id"], (verdict, []))[1].append(audit["seed"])
    ranked = sorted(
        found.values(), key=lambda each: (SEVERITIES.index(each[0]["severity"]), each[0]["id"])
    )
    return [
        (verdict["id"], verdict["severity"], _seeds(seeds, len(audits)), one_line(verdict["claim"]))
        for verdict, seeds in ranked
    ]


def _error_rows(failed: Sequence[Document]) -> list[tuple[str, str, str, str]]:
    """Errors that prevented audits, with their seeds."""
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
    return f"{count} {what}" if count == 1 else f"{count:,} {what}s"
