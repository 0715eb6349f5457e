"""Judgements made a second time: which verdicts are drawn, and how far both judges agree.

Prints the verdicts that are to be judged by another judge, with what the audit says of them, where
the environment's source lies, and without the first judgement: those of judgements_again.toml are
left out. The other judge's words are kept in judgements_blind.toml, as the answers at the end say.

    python benchmarks/zoo/again.py --results FOLDER [FOLDER ...] [--judgements FILE] [--count 30]
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, Final

HERE: Final = Path(__file__).parent
AGAIN: Final = HERE / "judgements_again.toml"
BLIND: Final = HERE / "judgements_blind.toml"
FAULTS: Final = ("true", "same cause")
"""Judgements that say that a fault is there."""
Judgements = Mapping[str, Mapping[str, str]]


GUIDE: Final = """\
# Thirty verdicts on public environments

For each: is it right? Read the environment's source, and nothing that was judged before. Words:

- true: a maintainer would fix it
- same cause: true, and told by another verdict of the same environment already
- pedantic: true as the API's words have it, of no consequence
- false: the environment does what it should
"""


def main() -> int:
    """Prints the verdicts drawn, and answers to fill in; 0 in any case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", type=Path, nargs="+", required=True)
    parser.add_argument("--judgements", type=Path, default=HERE / "judgements.toml")
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    judged = tomllib.loads(asked.judgements.read_text())
    known = tomllib.loads(AGAIN.read_text())
    pairs = drawn(judged, known, asked.count, asked.seed)
    print(GUIDE)
    for number, (key, check) in enumerate(pairs, 1):
        print("\n".join(shown(number, key, check, audit_of(asked.results, key))))
    print("# Answers\n\n```toml")
    for key, several in groupby(pairs, key=lambda pair: pair[0]):
        print(f'["{key}"]')
        for _, check in several:
            print(f'{check} = "WORD: reason, with file and line"')
    print("```")
    return 0


def drawn(judged: Judgements, known: Judgements, count: int, seed: int) -> list[tuple[str, str]]:
    """Pairs of environment and check, drawn from all that are judged and weren't drawn before."""
    pairs = {(key, check) for key, checks in judged.items() for check in checks}
    pairs -= {(key, check) for key, checks in known.items() for check in checks}
    return sorted(random.Random(seed).sample(sorted(pairs), min(count, len(pairs))))


def audit_of(folders: Sequence[Path], key: str) -> dict[str, Any]:
    """The audit of an environment, from the first folder that has it."""
    paths = (folder / f"{key.replace('/', '+')}.json" for folder in folders)
    found: dict[str, Any] = json.loads(next(path for path in paths if path.exists()).read_text())
    return dict(found["audit"])


def shown(number: int, key: str, check: str, audit: Mapping[str, Any]) -> Iterator[str]:
    """One verdict: the promise, the place, the values, the program, and where the rules lie."""
    verdict = next(each for each in audit["verdicts"] if each["id"] == check)
    source = audit.get("source") or {}
    yield f"## {number}. {key}, {check}\n"
    yield f"The promise: {verdict['claim']}\n"
    yield f"- rules: `{source.get('class')}`, {source.get('file')}:{source.get('line', 1)}"
    finding = verdict["findings"][0]
    for name in ("where", "expected", "actual", "fix"):
        yield f"- {name}: {finding[name]}"
    yield f"\n```python\n{finding['reproducer']}```\n"


def blind_agreement(judged: Judgements, blind: Judgements) -> Iterator[str]:
    """Section of the page: how often a judge who hadn't seen the first judgements says the same."""
    pairs = [
        (key, check, judged[key][check].partition(":")[0], *_said(words))
        for key, checks in blind.items()
        for check, words in checks.items()
    ]
    same = sum(first == second for _, _, first, second, _ in pairs)
    alike = sum((first in FAULTS) == (second in FAULTS) for _, _, first, second, _ in pairs)
    yield "## Judged blind"
    yield (
        f"{len(pairs)} further verdicts, drawn by the same script, were judged by somebody who had "
        f"seen no judgement: {same} have the same word, {alike} agree whether a fault is there."
    )
    for key, check, first, second, reason in pairs:
        if first != second:
            yield f"- **{key}** {check}: first {first}, then {second}: {reason}"
    yield ""


def _said(words: str) -> tuple[str, str]:
    word, _, reason = words.partition(":")
    return word, reason.strip()


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
