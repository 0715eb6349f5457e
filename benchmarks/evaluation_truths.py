"""Evaluation where the truth is known: how often its intervals hold it, and how often it errs.

    python benchmarks/evaluation_truths.py [--quick] [--only PART]

Prints a JSON line for each cell. `held`: the part of simulated experiments whose 95 % interval
holds the truth, in percent; `refused`: the part without an interval; `wrong`: the part in which an
interval was printed that doesn't hold it; `false`: the part with at least one claim that isn't
true; `found`: the part that claims what is true. The code under test is the package's own, from
arrays of returns on.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.random import Generator

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.training_runs import over_meetings

Line = dict[str, Any]
SEEDS = 50
"""Episode seeds that all line-ups share."""


def percent(hits: Any) -> float:
    """The part that is true."""
    return round(100 * float(np.mean(hits)), 1)


def judged(interval: Callable[[Generator], Any], truth: float, repeats: int, seed: int) -> Line:
    """How often an interval holds the truth, over experiments of their own."""
    held, refused = [], 0
    for repeat in range(repeats):
        try:
            found = interval(np.random.default_rng([seed, repeat]))
        except EvidenceError:
            refused += 1
            continue
        held.append(found.low - 1e-9 <= truth <= found.high + 1e-9)
    line = {"held": percent(held) if held else None, "refused": round(100 * refused / repeats, 1)}
    return line | {"wrong": round(100 * (len(held) - sum(held)) / repeats, 1)}


def met(rng: Generator, runs: int, seeds: float, apart: float, noise: float) -> Any:
    """[runs, runs, episodes] the first seat's return where run i meets run j; truth 0."""
    own = apart * rng.normal(size=(2, runs))
    luck = seeds * rng.normal(size=SEEDS)
    rest = noise * rng.normal(size=(runs, runs, SEEDS))
    return own[0][:, None, None] + own[1][None, :, None] + luck + rest


def rivals(rng: Generator, runs: int, seeds: float, apart: float, noise: float) -> Any:
    """The same of a symmetric game: what one wins the other loses, but for the deal."""
    own = apart * rng.normal(size=runs)
    luck = seeds * rng.normal(size=SEEDS)
    rest = noise * rng.normal(size=(runs, runs, SEEDS))
    return own[:, None, None] - own[None, :, None] + luck + rest


def of_its_runs(met_ije: Any) -> Any:
    """[runs, episodes] of each run the mean over all meetings with other runs, in both seats."""
    others = ~np.eye(len(met_ije), dtype=bool)
    rows = [(met_ije[k][others[k]], met_ije[:, k][others[k]]) for k in range(len(met_ije))]
    return np.stack([np.concatenate(each).mean(axis=0) for each in rows])


def two_meet(rng: Generator, runs: int, *spreads: float) -> Any:
    """The interval of two methods' meetings."""
    found = met(rng, runs, *spreads)
    return over_meetings([found.mean(axis=1), found.mean(axis=0)])


def zero_shot(game: Callable[..., Any], rng: Generator, runs: int, *spreads: float) -> Any:
    """The interval of the meetings of one method's runs."""
    found = of_its_runs(game(rng, runs, *spreads))
    return over_meetings([found], times=2 * (runs - 1) / (runs - 2))


def meetings(repeats: int) -> Iterator[Line]:
    """Cells of cross-play in which runs of methods meet, about new runs and new seeds."""
    cases = [(10, s, a, n) for s in (0.0, 0.5, 2.0) for a in (0.1, 1.0) for n in (0.3, 3.0)]
    ways: dict[str, Callable[..., Any]] = {
        "two methods meet": two_meet,
        "zero-shot": partial(zero_shot, met),
        "zero-shot, symmetric game": partial(zero_shot, rivals),
    }
    for case in [*cases, (20, 0.5, 0.1, 0.3), (20, 2.0, 1.0, 3.0)]:
        runs, luck, apart, noise = case
        of = f"{runs} runs {apart} apart, seeds {luck}, noise {noise}"
        for claim, way in ways.items():
            line = judged(lambda rng, way=way, case=case: way(rng, *case), 0.0, repeats, 1)
            yield {"claim": claim, "of": of} | line


PARTS = {"meetings": meetings}


def main() -> None:
    """Prints the lines."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="100 repetitions")
    parser.add_argument("--only", choices=PARTS, action="append", help="these parts alone")
    parser.add_argument("--repeats", type=int, default=1_000)
    options = parser.parse_args()
    for part in options.only or PARTS:
        for line in PARTS[part](100 if options.quick else options.repeats):
            spent = {"seconds": round(time.process_time(), 1)}
            print(json.dumps({"part": part} | line | spent), flush=True)


if __name__ == "__main__":
    main()
