"""The page docs/zoo-anew.md: environments that weren't tuned on, audited anew, with judgements.

Verdicts of failed, suspected and erroneous checks are kept in audited_anew.json, judgements in
judgements.toml. With `--results` first audits that audit.py left are added to that file.

    python benchmarks/zoo/anew.py [--results FOLDER | --after FOLDER] > docs/zoo-anew.md

With `--after` results are kept beside those of the same environments: of audits by checks that were
changed since, by these environments too.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parent))
from catalogue import GROUPS, HERE, catalogue

KEPT: Final = HERE / "audited_anew.json"
JUDGED: Final = ("true", "same cause", "pedantic", "false")
Row = Mapping[str, Any]


def main() -> int:
    """Prints the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, help="folder of audit.py's results")
    parser.add_argument("--after", type=Path, help="the same, of audits by changed checks")
    asked = parser.parse_args()
    rows = json.loads(KEPT.read_text())
    if asked.results:
        known = {row["key"] for row in rows}
        rows += [row for row in kept(asked.results) if row["key"] not in known]
    if asked.after:
        later = {row["key"]: row for row in kept(asked.after)}
        rows = [{**row, "after": later.get(row["key"], row.get("after"))} for row in rows]
    KEPT.write_text(json.dumps(rows, indent=1) + "\n")
    judged = tomllib.loads((HERE / "judgements.toml").read_text())
    groups = tomllib.loads(GROUPS.read_text())
    third, second = ([r for r in rows if r["key"] in groups[name]] for name in ("third", "second"))
    first = [row for row in rows if row not in third and row not in second]
    parts = [*opening(first, second, third)]
    for name, lot in (("third", third), ("second", second), ("first", first)):
        parts += [f"## The {name} lot: how often a check is right\n", *counts(lot, judged)]
    parts += [*after(rows, judged), *table(rows, judged)]
    print("\n".join(parts))
    return 0


def kept(folder: Path) -> Iterator[Row]:
    """What the page needs of each audit of an environment that no check was changed by."""
    tuned = {
        *tomllib.loads(GROUPS.read_text())["tuned"],
        *tomllib.loads(GROUPS.read_text())["later"],
    }
    for each in catalogue():
        path = folder / f"{each.key.replace('/', '+')}.json"
        if each.key in tuned or not path.exists():
            continue
        result = json.loads(path.read_text())
        verdicts = result.get("audit", {}).get("verdicts")
        if verdicts is None:
            continue
        told = [one for one in verdicts if one["outcome"] in ("failed", "suspected", "error")]
        yield {
            "key": each.key,
            "version": each.version,
            "gamekeeper": result["gamekeeper"],
            "audited": result["audited"],
            "limit_s": result["limit_s"],
            "seconds": result["seconds"],
            "outcomes": Counter(one["outcome"] for one in verdicts),
            "verdicts": [
                {
                    "id": one["id"],
                    "outcome": one["outcome"],
                    "severity": one["severity"],
                    "follows_from": one["follows_from"] and one["follows_from"]["id"],
                    "reproduced": one["reproduced"],
                }
                for one in told
            ],
        }


def causes(row: Row) -> list[str]:
    """Checks that failed with severity high or medium and follow from nothing."""
    return [
        each["id"]
        for each in row["verdicts"]
        if each["outcome"] == "failed" and each["severity"] != "low" and not each["follows_from"]
    ]


def word(judged: Mapping[str, Mapping[str, str]], row: Row, check: str) -> tuple[str, str]:
    """Judgement of a cause, and its reason."""
    found, _, reason = judged.get(row["key"], {}).get(check, "not judged").partition(": ")
    return found, reason


def opening(first: Sequence[Row], second: Sequence[Row], third: Sequence[Row]) -> Iterator[str]:
    """Heading, and how it was done."""
    yield "# Public environments, audited anew\n"
    yield (
        f"Made by `python benchmarks/zoo/anew.py`. **The first lot**: {_lot(first)}, of the "
        "[catalogue](zoo.md) that no check was changed by, with a load of 5 to 13. Judgements of "
        f"causes told before stand as they were.\n\n**The second lot**: {_lot(second)}, found by "
        "the rule of the catalogue once checks had been changed by all the others, and fixed "
        "before their first audit; a "
        "load of 9 to 15. They are repositories of any quality: most can't be trained on as they "
        "are, so their faults are the first calls'.\n\n"
        f"**The third lot**: {_lot(third)}, by the rule that groups.toml gives, further down the "
        "rule's list, and fixed before the first audit; the default budget with `--seconds 150`, "
        "two at a time. Three of them are the same tutorial of PettingZoo, finished by two "
        "authors, so their causes aren't independent.\n\n"
        "The others were audited with `--quick --seconds 90`. All ran on two cores and were judged "
        "by the source, by one judge. Checks were changed by these audits afterwards, not "
        "before.\n"
    )


def _lot(rows: Sequence[Row]) -> str:
    """Numbers of environments and packages, and the commit of their audits."""
    commits = ", ".join(sorted({row["gamekeeper"] for row in rows}))
    packages = {row["key"].rpartition("/")[0] for row in rows}
    return f"{len(rows)} environments of {len(packages)} packages, at commit {commits}"


def counts(rows: Sequence[Row], judged: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    """How many causes are true, by check."""
    words: Counter[tuple[str, str]] = Counter()
    for row in rows:
        for check in causes(row):
            words[check, word(judged, row, check)[0]] += 1
            words["all", word(judged, row, check)[0]] += 1
    yield f"| check | failed | {' | '.join(JUDGED)} | true of judged | a fault of judged |"
    yield "|---|---|" + "---|" * (len(JUDGED) + 2)
    for check in sorted({check for check, _ in words}):
        each = [words[check, name] for name in JUDGED]
        shares = [f"{100 * n / sum(each):.0f} %" for n in (each[0], sum(each[:2])) if sum(each)]
        failed = sum(count for (id, _), count in words.items() if id == check)
        yield "| " + " | ".join(map(str, [check, failed, *each, *shares])) + " |"
    shown = [
        each["reproduced"]
        for row in rows
        for each in row["verdicts"]
        if each["outcome"] == "failed" and not each["follows_from"]
    ]
    whole = sum(one["failed"] == 5 and one["unchanged_passed"] is not False for one in shown)
    share = f"{whole} of {len(shown)}"
    yield f"\nReproducers of causes that fail 5 of 5, the unchanged one passing: {share}."
    over = max(row["seconds"] - row["limit_s"] for row in rows)
    yield f"The longest audit ended {over:.0f} s after its time limit, process start included.\n"


def after(rows: Sequence[Row], judged: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    """Environments that were audited again by checks that they had changed."""
    again = [(row, row["after"]) for row in rows if row.get("after")]
    if not again:
        return
    commits = ", ".join(sorted({later["gamekeeper"] for _, later in again}))
    words = Counter(word(judged, row, id)[0] for row, later in again for id in causes(later))
    counted = ", ".join(f"{words[name]} {name}" for name in (*JUDGED, "not judged") if words[name])
    yield "## After the changes\n"
    yield (
        f"{len(again)} environments of which a cause wasn't true, audited once more at commit "
        f"{commits}, once checks had been changed by them: {counted}. "
        "They are tuned on by now, so this says what was changed, and not how often a check is "
        "right elsewhere.\n"
    )
    yield "| environment | causes before | causes after | follow |"
    yield "|---|---|---|---|"
    for row, later in again:
        told = [
            ", ".join(f"{id} {word(judged, row, id)[0]}" for id in causes(each)) or "none"
            for each in (row, later)
        ]
        follow = [each["id"] for each in later["verdicts"] if each["follows_from"]]
        yield f"| {row['key']} | {told[0]} | {told[1]} | {', '.join(follow)} |"
    yield ""


def table(rows: Sequence[Row], judged: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    """A row for each environment, then the reasons."""
    yield "## The environments\n"
    yield "| environment | passed | not exercised | causes | follow | suspected | s |"
    yield "|---|---|---|---|---|---|---|"
    for row in rows:
        told = [f"{check} {word(judged, row, check)[0]}" for check in causes(row)]
        follow = [each["id"] for each in row["verdicts"] if each["follows_from"]]
        suspected = [each["id"] for each in row["verdicts"] if each["outcome"] == "suspected"]
        out = row["outcomes"]
        cells = [row["key"], out.get("passed", 0), out.get("not_exercised", 0)]
        cells += [", ".join(told) or "none", ", ".join(follow), ", ".join(suspected)]
        yield "| " + " | ".join(map(str, [*cells, round(row["seconds"])])) + " |"
    yield "\n## What was judged, and where the source says so\n"
    for row in rows:
        for check in causes(row):
            found, reason = word(judged, row, check)
            yield f"- **{row['key']}** {check}, {found}: {reason}"


if __name__ == "__main__":
    sys.exit(main())
