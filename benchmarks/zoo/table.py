"""The page docs/zoo.md: audits of the catalogue, judgements, and how often each check is right.

Reads the results that audit.py kept, and judgements.toml: whether an environment's source shows the
fault, for each failed verdict of severity high or medium that is a cause.

    python benchmarks/zoo/table.py --results FOLDER [FOLDER ...] > docs/zoo.md
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parent))
from again import AGAIN, BLIND, agreement, blind_agreement
from catalogue import CATALOGUE, HERE, Listed, catalogue
from prove import TRIES

JUDGED: Final = ("true", "same cause", "pedantic", "false")
FINDINGS: Final = HERE.parents[1] / "docs" / "findings"
SHOWN: Final[Mapping[str, tuple[str, ...]]] = {
    "tuned": ("tuned",),
    "related": ("related",),
    "new": ("new",),
    "related and new": ("related", "new"),
    "left": ("left",),
    "fresh": ("fresh",),
    "left and fresh": ("left", "fresh"),
}
"""Groups of environments that precision is counted over."""
SINGLE: Final = tuple(name for name, groups in SHOWN.items() if groups == (name,))
BY_CHECK: Final = ("tuned", "related and new", "left and fresh")
EXERCISED: Final = ("passed", "failed", "suspected", "waived")
Judgements = Mapping[str, Mapping[str, str]]


@dataclass(frozen=True, slots=True)
class Row:
    """One environment of the table."""

    listed: Listed
    result: Mapping[str, Any] | None

    @property
    def verdicts(self) -> list[dict[str, Any]]:
        """Verdicts of its audit, or none."""
        audit = (self.result or {}).get("audit") or {}
        return list(audit.get("verdicts", ()))

    def failed(self, *severities: str, cause: bool) -> list[str]:
        """Checks that failed, as causes or as what follows from one."""
        return [
            each["id"]
            for each in self.verdicts
            if each["outcome"] == "failed"
            and each["severity"] in severities
            and (each.get("follows_from") is None) == cause
        ]

    @property
    def causes(self) -> list[str]:
        """Checks that failed with severity high or medium and follow from nothing."""
        return self.failed("high", "medium", cause=True)


def main() -> int:
    """Prints the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, nargs="+", required=True)
    parser.add_argument("--judgements", type=Path, default=HERE / "judgements.toml")
    asked = parser.parse_args()
    rows = [Row(each, _result(asked.results, each)) for each in catalogue()]
    judged = tomllib.loads(asked.judgements.read_text())
    again = tomllib.loads(AGAIN.read_text())
    parts = [opening(rows), written_up(), precision(rows, judged), shown_later(rows, judged)]
    parts.append(agreement(again))
    if BLIND.exists():
        parts.append(blind_agreement(judged, tomllib.loads(BLIND.read_text())))
    parts.append(table(rows, judged))
    print("\n".join(line for part in [*parts, rest(rows, judged)] for line in part))
    return 0


def opening(rows: list[Row]) -> Iterator[str]:
    """Heading, the rule of gathering, and counts."""
    yield (HERE / "opening.txt").read_text().rstrip()
    yield ""
    packages = {row.listed.package for row in rows}
    audited = [row for row in rows if row.verdicts]
    groups = Counter(row.listed.group for row in audited)
    yield (
        f"{len(rows)} environments of {len(packages)} packages, "
        f"{sum('/' in each for each in packages)} of them public repositories. "
        f"{len(audited)} gave an audit: {groups['tuned']} tuned, {groups['related']} related, "
        f"{groups['new']} new, {groups['left']} left, {groups['fresh']} fresh."
    )
    yield ""


def written_up() -> Iterator[str]:
    """Pages of findings, each with the number of faults that it describes."""
    counts = {
        path: sum(line.startswith("## ") for line in path.read_text().splitlines())
        for path in sorted(FINDINGS.glob("*.md"))
    }
    yield "## Faults written up"
    yield f"{sum(counts.values())} faults of {len(counts)} packages, by reading the source:"
    yield ", ".join(f"[{path.stem}](findings/{path.name}) {n}" for path, n in counts.items())
    yield ""


def precision(rows: list[Row], judged: Judgements) -> Iterator[str]:
    """How many causes of each check are true, in environments tuned on and in the others."""
    yield "## How often a check is right"
    yield "Failed verdicts of severity high or medium that are causes, as judged; *a fault* is"
    yield "what is true, or the same cause told again.\n"
    ends = "not judged | true of judged | a fault of judged"
    yield f"| group | check | failed | {' | '.join(JUDGED)} | {ends} |"
    yield "|---|---|---|" + "---|" * (len(JUDGED) + 3)
    for shown, groups in SHOWN.items():
        counts: Counter[tuple[str, str]] = Counter()
        for row in rows:
            if row.listed.group in groups:
                for check in row.causes:
                    counts[check, _judgement(judged, row, check)[0]] += 1
                    counts["all", _judgement(judged, row, check)[0]] += 1
        for check in sorted({check for check, _ in counts}):
            if check == "all" or shown in BY_CHECK:
                yield _precision_row(shown, check, counts)
    yield ""


def shown_later(rows: list[Row], judged: Judgements) -> Iterator[str]:
    """What audits could only suspect, as their time was over, and prove.py showed afterwards."""
    counts = {group: Counter[str]() for group in SINGLE}
    for row in rows:
        for check, ran in (row.result or {}).get("proved", {}).items():
            count = counts[row.listed.group]
            count["run"] += 1
            if ran["failed"] == TRIES:
                count["shown"] += 1
                count[_judgement(judged, row, check)[0]] += 1
    yield "## Suspected for want of time"
    yield "Verdicts of severity high or medium whose reproducer the audit had no time for were run"
    yield f"afterwards, by `benchmarks/zoo/prove.py`: what fails {TRIES} times is shown.\n"
    yield f"| group | run | shown | {' | '.join(JUDGED)} | not judged |"
    yield "|---|---|---|" + "---|" * (len(JUDGED) + 1)
    for group, count in counts.items():
        words = [group, count["run"], count["shown"], *(count[word] for word in (*JUDGED, ""))]
        yield "| " + " | ".join(map(str, words)) + " |"
    yield ""


def _precision_row(group: str, check: str, counts: Mapping[tuple[str, str], int]) -> str:
    each = [counts[check, word] for word in JUDGED]
    unjudged = counts[check, ""]
    shares = [f"{100 * n / sum(each):.0f} %" if sum(each) else "" for n in (each[0], sum(each[:2]))]
    cells = [group, check, sum(each) + unjudged, *each, unjudged, *shares]
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def table(rows: list[Row], judged: Judgements) -> Iterator[str]:
    """A row for each environment."""
    yield "## The environments"
    yield "A cause stands with its judgement; *checks* counts those that had something to judge"
    yield "within the time, *follow* what follows from a cause.\n"
    yield "| package | environment | group | checks | causes | follow | minor | suspected | s |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for package, several in groupby(rows, key=lambda row: row.listed.package):
        for place, row in enumerate(several):
            shown = f"{package} {row.listed.version[:10]}" if place == 0 else ""
            yield f"| {shown} | {row.listed.name} | {row.listed.group} | {_cells(row, judged)} |"
    yield ""


def _cells(row: Row, judged: Judgements) -> str:
    if row.result is None:
        return " | not audited | | | | "
    if not row.verdicts:
        return f" | {_ended(row.result)} | | | | {row.result['seconds']:.0f}"
    judged_here = [each for each in row.verdicts if each["outcome"] in EXERCISED]
    causes = [f"{check} {_judgement(judged, row, check)[0]}".strip() for check in row.causes]
    follow = len(row.failed("high", "medium", "low", cause=False))
    suspected = [each["id"] for each in row.verdicts if each["outcome"] == "suspected"]
    cells = [
        len(judged_here),
        ", ".join(causes) or "none",
        follow or "",
        ", ".join(row.failed("low", cause=True)),
        ", ".join(suspected),
        round(row.result["seconds"]),
    ]
    return " | ".join(str(cell) for cell in cells)


def _ended(result: Mapping[str, Any]) -> str:
    said = str(result.get("ended") or result.get("audit", {}).get("error") or "no verdict")
    return "no audit: " + " ".join(said.splitlines()[-1:])[-120:].replace("|", "/")


def rest(rows: list[Row], judged: Judgements) -> Iterator[str]:
    """Judgements in words, and what can't be had."""
    yield "## What was judged, and where the source says so"
    for row in rows:
        for check in [*row.causes, *(row.result or {}).get("proved", {})]:
            word, reason = _judgement(judged, row, check)
            if word:
                yield f"- **{row.listed.key}** {check}, {word}: {reason}"
    yield "\n## What can't be had"
    yield "| package | why |\n|---|---|"
    for name, why in tomllib.loads(CATALOGUE.read_text())["left_out"].items():
        yield f"| {name} | {why} |"


def _judgement(judged: Judgements, row: Row, check: str) -> tuple[str, str]:
    word, _, reason = judged.get(row.listed.key, {}).get(check, "").partition(": ")
    return (word, reason.strip())


def _result(folders: Sequence[Path], each: Listed) -> Mapping[str, Any] | None:
    """The result of its first audit, from the first folder that has one."""
    paths = (folder / f"{each.key.replace('/', '+')}.json" for folder in folders)
    path = next((path for path in paths if path.exists()), None)
    return None if path is None else json.loads(path.read_text())


if __name__ == "__main__":
    sys.exit(main())
