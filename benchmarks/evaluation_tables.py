"""Tables of docs/reference/coverage.md and docs/statistics.md.

    python benchmarks/evaluation_tables.py TRUTHS.jsonl...

`evaluation_coverage.py --table` prints those of its own lines. This prints those of the lines that
`evaluation_truths.py` prints: cells by lot, each and by kind of interval; false claims by design.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

Line = dict[str, Any]

TITLES = {
    "episodes": "Episodes of one checkpoint",
    "quantiles": "Quantiles of episodes",
    "runs": "Training runs of a method",
    "hierarchy": "Runs by episodes",
    "environments": "Several environments",
    "beats": "Comparisons of two",
    "stopping": "Stopping",
    "tails": "Longer tails",
    "fresh": "Distributions that no constant was chosen on",
}


def table(lines: list[Line]) -> Iterator[str]:
    """Markdown: a table for each part, a distribution a row, a claim and n a column."""
    for part in dict.fromkeys(line["part"] for line in lines):
        mine = [line for line in lines if line["part"] == part]
        columns = list(dict.fromkeys(map(heading, mine)))
        cells = {(line["of"], heading(line)): cell(line) for line in mine}
        yield f"\n### {TITLES[part]}\n\n| | {' | '.join(columns)} |\n|---|{'---|' * len(columns)}"
        for of in dict.fromkeys(line["of"] for line in mine):
            yield f"| {of} | {' | '.join(cells.get((of, key), '') for key in columns)} |"


def outside(lines: list[Line]) -> Iterator[str]:
    """Markdown: how many cells are within, and each that isn't, with what is known of it."""
    counted = [line for line in lines if "held" in line]
    off = [line for line in counted if not 93 <= line["held"] <= 97]
    low = [line for line in off if line["held"] < 93]
    lumps = [line for line in off if line["held"] > 97 < line.get("least", 0)]
    yield (
        f"\n### Cells outside\n\n{len(counted) - len(off)} of {len(counted)} cells are within 93 "
        f"and 97 %, {len(low)} below, {len(off) - len(low)} above; of these {len(lumps)} are above "
        "for every interval that covers 93 % elsewhere too (last column).\n\n"
        "| claim | of | n | covers | any interval at least |\n|---|---|---|---|---|"
    )
    for line in sorted(off, key=lambda line: line["held"]):
        least = line.get("least", "")
        yield f"| {line['claim']} | {line['of']} | {line.get('n', '')} | {line['held']} | {least} |"


def heading(line: Line) -> str:
    """What a column is of."""
    return line["claim"] + (f", n = {line['n']}" if "n" in line else "")


def cell(line: Line) -> str:
    """The coverage; what the usual interval covers in brackets; where it stopped."""
    usual = f" ({line['usual']})" if "usual" in line else ""
    names = [name for name in ("held", "held_fresh") if name in line]
    refused = f", {line['refused']} % refused" if "refused" in line else ""
    if not names:
        return "refused"
    stop = f" at {line['stopped']}" if "stopped" in line else ""
    return f"{line[names[0]]}{usual}{refused}{stop}"


def of_lots(lines: list[Line]) -> Iterator[str]:
    """Markdown: cells by lot, a kind of interval a row."""
    yield "| interval | cells | with an interval | covers, least to most | outside 93 and 97 |"
    yield "|---|---|---|---|---|"
    for claim in dict.fromkeys(line["claim"] for line in lines):
        mine = [line for line in lines if line["claim"] == claim]
        held = [line["held"] for line in mine if line["held"] is not None]
        off = [f"{each}" for each in sorted(held) if not 93 <= each <= 97]
        reach = f"{min(held)} to {max(held)}" if held else "-"
        yield f"| {claim} | {len(mine)} | {len(held)} | {reach} | {', '.join(off) or '-'} |"


def each_of_lots(lines: list[Line]) -> Iterator[str]:
    """Markdown: cells by lot, one a row; those without an interval are named below."""
    yield "| interval | of | n | covers | refused |\n|---|---|---|---|---|"
    for line in lines:
        if line["held"] is not None:
            which = f"| {line['claim']} | {line['of']} | {line['n']} |"
            yield f"{which} {line['held']} | {line['refused'] or ''} |"
    refused = [line for line in lines if line["held"] is None]
    names = [f"{line['claim']} of {line['n']} ({line['of'].split(',')[0]})" for line in refused]
    yield f"\nRefused in every experiment, {len(refused)} cells: {', '.join(names)}."


def of_families(lines: list[Line]) -> Iterator[str]:
    """Markdown: how often anything false is claimed, and what is true is found."""
    yield "| design | of | false claims | found |\n|---|---|---|---|"
    for line in lines:
        if "false" in line or "found" in line:
            found = f"{line['found']} %" if "found" in line else ""
            found += f" (paired t-test {line['found_by_t']} %)" if "found_by_t" in line else ""
            false = f"{line['false']} %" if "false" in line else ""
            yield f"| {line['claim']} | {line['of']} | {false} | {found} |"


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("truths", nargs="+", type=Path, metavar="TRUTHS.jsonl")
    texts = [path.read_text() for path in parser.parse_args().truths]
    lines = [json.loads(line) for text in texts for line in text.splitlines()]
    cells = [line for line in lines if line["part"] == "cells"]
    others = [line for line in lines if line["part"] != "cells"]
    for made in (of_lots(cells), each_of_lots(cells), of_families(others)):
        print("\n".join(made), end="\n\n")


if __name__ == "__main__":
    main()
