"""Tables of docs/reference/coverage.md, of the lines that `evaluation_coverage.py` prints."""

from __future__ import annotations

from collections.abc import Iterator
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
    "sequences": "Confidence sequences",
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
    names = [name for name in ("held", "held_of_all", "held_fresh") if name in line]
    refused = f", {line['refused']} % refused" if "refused" in line else ""
    if not names:
        return "refused"
    stop = f" at {line['stopped']}" if "stopped" in line else ""
    return f"{line[names[0]]}{usual}{refused}{stop}"
