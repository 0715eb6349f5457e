"""Judgements made a second time: which verdicts are drawn, and how far both judges agree.

Prints the verdicts that are to be judged again, with what the audit says of them and without the
first judgement. The second judge's words stand in judgements_again.toml.

    python benchmarks/zoo/again.py --results FOLDER [--judgements FILE] [--count 30]
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).parent
FAULTS: Final = ("true", "same cause")
"""Judgements that say that a fault is there."""
Judgements = Mapping[str, Mapping[str, str]]


def main() -> int:
    """Prints the verdicts drawn; 0 in any case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--judgements", type=Path, default=HERE / "judgements.toml")
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    judged = tomllib.loads(asked.judgements.read_text())
    for key, check in drawn(judged, asked.count, asked.seed):
        audit = json.loads((asked.results / f"{key.replace('/', '+')}.json").read_text())["audit"]
        verdict = next(each for each in audit["verdicts"] if each["id"] == check)
        print(f"{key} {check}: {verdict['claim']}")
        for name in ("where", "expected", "actual"):
            print(f"    {name}: {verdict['findings'][0][name]}")
    return 0


def drawn(judged: Judgements, count: int, seed: int) -> list[tuple[str, str]]:
    """Pairs of environment and check, drawn from all that are judged."""
    pairs = sorted((key, check) for key, checks in judged.items() for check in checks)
    return sorted(random.Random(seed).sample(pairs, min(count, len(pairs))))


def agreement(again: Judgements) -> Iterator[str]:
    """Section of the page: how often both judges say the same, and where they don't."""
    said = [
        (key, check, *words.partition(": ")[0].split(" / "), words.partition(": ")[2])
        for key, checks in again.items()
        for check, words in checks.items()
    ]
    same = sum(first == second for _, _, first, second, _ in said)
    alike = sum((first in FAULTS) == (second in FAULTS) for _, _, first, second, _ in said)
    yield "## Judged again"
    yield (
        f"{len(said)} verdicts, drawn by `benchmarks/zoo/again.py`, were judged a second time: "
        f"{same} have the same word, {alike} agree whether a fault is there. The second judge had "
        "once read the first judge's list: this is no blind judgement."
    )
    for key, check, first, second, reason in said:
        if first != second:
            yield f"- **{key}** {check}: first {first}, then {second}: {reason}"
    yield ""


if __name__ == "__main__":
    sys.exit(main())
