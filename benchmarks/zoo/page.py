"""The page docs/zoo.md: audits of public environments, judgements, and how often a check is right.

Audits are kept in audited.json, a line for each, judgements in judgements.toml. With `--results`
and `--lot` first audits that audit.py left are added to that file.

    python benchmarks/zoo/page.py [--results FOLDER --lot NAME] > docs/zoo.md
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, Final, get_args

sys.path.insert(0, str(Path(__file__).parent))
from catalogue import CATALOGUE, HERE, Group, Listed, catalogue

KEPT: Final = HERE / "audited.json"
FINDINGS: Final = HERE.parents[1] / "docs" / "findings"
WORDS: Final = ("true", "same cause", "pedantic", "false")
FAULTS: Final = WORDS[:2]
"""Judgements that say that a fault is there."""
LISTED: Final = get_args(Group)
APART: Final = LISTED[LISTED.index("second") :]
"""Lots of repositories that no audit had been run on."""
LOTS: Final = (*LISTED[: -len(APART)], "again", *APART, "changed")
SEVERAL: Final = 10
"""Failed verdicts from which a check's share is given."""
Row = Mapping[str, Any]
Judgements = Mapping[str, Mapping[str, str]]


def main() -> int:
    """Prints the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, help="folder of audit.py's results")
    parser.add_argument("--lot", choices=LOTS, help="the lot that they are of")
    asked = parser.parse_args()
    rows = json.loads(KEPT.read_text())
    if asked.results:
        added = {row["key"]: row for row in kept(asked.results, asked.lot)}
        rows = [row for row in rows if row["lot"] != asked.lot or row["key"] not in added]
        rows += added.values()
        lines = ",\n".join(json.dumps(row) for row in rows)
        KEPT.write_text(f"[\n{lines}\n]\n")
    judged = tomllib.loads((HERE / "judgements.toml").read_text())
    parts = [opening(rows), lots(rows, judged), checks(rows, judged), judges(judged)]
    parts += [written_up(), table(rows, judged), changed(rows, judged), left_out()]
    print("\n".join(line for part in parts for line in part))
    return 0


def kept(folder: Path, lot: str) -> Iterator[Row]:
    """What the page needs of each audit of a lot: a line of audited.json."""
    for each in catalogue():
        path = folder / f"{each.key.replace('/', '+')}.json"
        if not path.exists() or (lot != "changed" and each.group != lot):
            continue
        result = json.loads(path.read_text())
        if "verdicts" not in result.get("audit", {}):  # it ended without an audit
            continue
        verdicts = result["audit"]["verdicts"]
        failed = [one for one in verdicts if one["outcome"] == "failed"]
        own = [one for one in failed if not one["follows_from"]]
        shown = [one["reproduced"] for one in own]
        whole = [one["failed"] == 5 and one["unchanged_passed"] is not False for one in shown]
        yield {
            "key": each.key,
            "lot": lot,
            "gamekeeper": result["gamekeeper"],
            "causes": [one["id"] for one in own if one["severity"] != "low"],
            "follow": len(failed) - len(own),
            "low": [one["id"] for one in own if one["severity"] == "low"],
            "suspected": [one["id"] for one in verdicts if one["outcome"] == "suspected"],
            "seconds": round(result["seconds"]),
            "over": round(result["seconds"] - result["limit_s"]),
            "shown": [sum(whole), len(whole)],
        }


def opening(rows: Sequence[Row]) -> Iterator[str]:
    """Heading, rules, and how many there are."""
    yield (HERE / "opening.txt").read_text()
    keys = {row["key"] for row in rows}
    packages = {key.rpartition("/")[0] for key in keys}
    repositories = sum("/" in package for package in packages)
    yield (
        f"{len(keys)} environments of {len(packages)} packages gave an audit, {repositories} of "
        "the packages are public repositories.\n"
    )


def lots(rows: Sequence[Row], judged: Judgements) -> Iterator[str]:
    """Totals of each lot, and of the ones that were not tuned on."""
    yield "## How often an audit is right\n"
    yield f"| lot | commit | environments | causes | {' | '.join(WORDS)} | true | a fault |"
    yield "|---|---|---|---|" + "---|" * (len(WORDS) + 2)
    audited = [lot for lot in LOTS if any(row["lot"] == lot for row in rows)]
    for lot in audited:
        yield _total(lot, [row for row in rows if row["lot"] == lot], judged)
    bare = [row for row in rows if row["lot"] in APART]
    last = [lot for lot in audited if lot in APART][-1]
    yield _total(f"{APART[0]} to {last}", bare, judged)
    shown = [row["shown"] for row in rows if "shown" in row]
    whole, of = (sum(counts) for counts in zip(*shown, strict=True))
    over = max(row.get("over", 0) for row in rows)
    yield (
        f"\nThe bar is 95 % true. Of the lots from *again* on, {whole} of {of} reproducers of "
        "causes failed 5 times of 5, the unchanged program passing where there is one; the longest "
        f"audit ended {over} s after its time limit, process start included.\n"
    )


def _total(name: str, rows: Sequence[Row], judged: Judgements) -> str:
    counts = Counter(word(judged, row, check) for row in rows for check in row["causes"])
    commits = ", ".join(sorted({row.get("gamekeeper", "") for row in rows} - {""}))
    cells = [name, commits if name in LOTS else "", len(rows), counts.total()]
    return _line([*cells, *(counts[one] for one in WORDS), *_shares(counts)])


def _shares(counts: Counter[str]) -> list[str]:
    told = sum(counts[one] for one in WORDS)
    parts = (counts["true"], sum(counts[one] for one in FAULTS))
    return [f"{100 * part / told:.0f} %" if told else "" for part in parts]


def _line(cells: Sequence[object]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def word(judged: Judgements, row: Row, check: str) -> str:
    """Judgement of a cause: that of its lot, where there is one (`"GK638 changed"`)."""
    said = judged.get(row["key"], {})
    return said.get(f"{check} {row['lot']}", said.get(check, "not judged")).partition(":")[0]


def newest(rows: Sequence[Row]) -> dict[str, Row]:
    """The newest audit of each environment by checks that weren't changed by it."""
    return {row["key"]: row for row in rows if row["lot"] != "changed"}


def checks(rows: Sequence[Row], judged: Judgements) -> Iterator[str]:
    """How often each check is right, in the newest audit of each environment."""
    found = newest(rows)
    before = by_check(found.values(), judged)
    after = by_check({row["key"]: row for row in rows}.values(), judged)
    apart = by_check((row for row in found.values() if row["lot"] != "tuned"), judged)
    yield "## How often a check is right\n"
    yield "The newest audit of each environment that its checks weren't changed by; *not tuned*: of"
    yield "the causes, those of lots other than *tuned*; *after*: of the newest audit of all, those"
    yield "[after the changes](#after-the-changes) included: it says what was changed,"
    yield f"and nothing about other environments. Shares from {SEVERAL} causes on.\n"
    titles = ["check", "causes", "not tuned", *WORDS, "true", "a fault", "after: causes", "true"]
    yield _line(titles)
    yield "|" + "---|" * len(titles)
    for check in [*sorted((before.keys() | after.keys()) - {"all"}), "all"]:
        each, later = before[check], after[check]
        shares = _shares(each) if each.total() >= SEVERAL else ["", ""]
        share = _shares(later)[0] if later.total() >= SEVERAL else ""
        words = (each[one] for one in WORDS)
        yield _line(
            [check, each.total(), apart[check].total(), *words, *shares, later.total(), share]
        )
    yield ""


def by_check(rows: Iterable[Row], judged: Judgements) -> dict[str, Counter[str]]:
    """Judgements of each check's causes, and of all."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for row in rows:
        for check in row["causes"]:
            said = word(judged, row, check)
            counts[check][said] += 1
            counts["all"][said] += 1
    return counts


def judges(judged: Judgements) -> Iterator[str]:
    """How far a second judge agrees with the first."""
    yield "## A second judge\n"
    again = tomllib.loads((HERE / "judgements_again.toml").read_text())
    first = [
        said.partition(":")[0].split(" / ") for checks in again.values() for said in checks.values()
    ]
    for pairs, who in (
        (_both(judged, "blind"), "who had seen none"),
        (_both(judged, "strict"), "who had read which checks of their lots weren't true"),
        (first, "who had once read the first list"),
    ):
        same = sum(one == two for one, two in pairs)
        alike = sum((one in FAULTS) == (two in FAULTS) for one, two in pairs)
        yield (
            f"{len(pairs)} verdicts, drawn at random, were judged again by a judge {who}: {same} "
            f"have the same word, {alike} agree whether a fault is there."
        )
    yield ""


def _both(judged: Judgements, name: str) -> list[list[str]]:
    """The words of the first judge and of a second, for each verdict of `judgements_NAME.toml`."""
    second = tomllib.loads((HERE / f"judgements_{name}.toml").read_text())
    return [
        [judged[key][check].partition(":")[0], said.partition(":")[0]]
        for key, checks in second.items()
        for check, said in checks.items()
    ]


def written_up() -> Iterator[str]:
    """Pages of findings, each with the number of faults that it describes."""
    counts = {
        path: sum(line.startswith("## ") for line in path.read_text().splitlines())
        for path in sorted(FINDINGS.glob("*.md"))
    }
    yield "## Faults written up\n"
    yield f"{sum(counts.values())} faults of {len(counts)} packages, each with a program that shows"
    yield "it without Gamekeeper, its place in the source, and a fix:"
    yield ", ".join(f"[{path.stem}](findings/{path.name}) {n}" for path, n in counts.items())
    yield ""


def table(rows: Sequence[Row], judged: Judgements) -> Iterator[str]:
    """A row for each environment, of its newest audit."""
    found = newest(rows)
    yield "## The environments\n"
    yield "The newest audit by checks that the environment hadn't changed; *first* lot and its"
    yield "causes, if an earlier audit told others; *follow* counts what follows from a cause.\n"
    yield "| package | environment | lot | causes | follow | minor | suspected | s | first |"
    yield "|---|---|---|---|---|---|---|---|---|"
    first = {row["key"]: row for row in reversed(rows)}
    for package, several in groupby(catalogue(), key=lambda each: each.package):
        name = _linked(package)
        for each in several:
            yield _line([name, each.name, *_cells(each, found, first, judged)])
            name = ""
    yield ""


def _linked(package: str) -> str:
    """The package's name, with its page of findings: of its name, or of its owner's and its own."""
    owner, _, name = package.rpartition("/")
    for stem in (name, f"{owner}-{name}"):
        page = FINDINGS / f"{stem.lower().replace('_', '-')}.md"
        if page.exists() and owner in page.read_text().partition("\n")[0]:
            return f"[{package}](findings/{page.name})"
    return package


def _cells(
    each: Listed, found: Mapping[str, Row], first: Mapping[str, Row], judged: Judgements
) -> list[object]:
    row = found.get(each.key)
    if row is None:
        return [each.group, "no audit", "", "", "", "", ""]
    before = first[each.key]
    told = "" if before["causes"] == row["causes"] else _told(before, judged)
    return [
        row["lot"],
        _told(row, judged),
        row["follow"] or "",
        ", ".join(row["low"]),
        ", ".join(row["suspected"]),
        row["seconds"],
        f"{before['lot']}: {told}" if told else "",
    ]


def _told(row: Row, judged: Judgements) -> str:
    return ", ".join(f"{id} {word(judged, row, id)}" for id in row["causes"]) or "none"


def changed(rows: Sequence[Row], judged: Judgements) -> Iterator[str]:
    """Environments that were audited once more after checks were changed by them."""
    before = newest(rows)
    yield "## After the changes\n"
    yield "Audits that reached the checks in question; *before*: the newest one of those above."
    yield "Those from magent2 to micro_battle ran at a load of 20 to 27: GK808 of magent2, and"
    yield "GK102, GK403 and GK802 of micro_battle, they had no time for. The catalogue had sent the"
    yield "target of escort below the ground, and doesn't any more.\n"
    yield "| environment | before | after |"
    yield "|---|---|---|"
    for row in rows:
        if row["lot"] == "changed":
            first = before.get(row["key"])
            told = "no audit" if first is None else _told(first, judged)
            yield _line([row["key"], told, _told(row, judged)])
    yield ""


def left_out() -> Iterator[str]:
    """What can't be had."""
    yield "## What can't be had\n"
    yield "| package | why |\n|---|---|"
    for name, why in tomllib.loads(CATALOGUE.read_text())["left_out"].items():
        yield _line([name, why])


if __name__ == "__main__":
    sys.exit(main())
