"""How often the intervals of evaluation hold the truth, by simulation, at the n each asks for.

    python benchmarks/evaluation_coverage.py [--quick] [--only PART] > coverage.jsonl
    python benchmarks/evaluation_coverage.py --table coverage.jsonl

Prints a JSON line for each claim, distribution and n: `held`, the part of the simulated experiments
whose 95 % interval holds the truth (in percent); where there is one, `usual`, what the usual way
holds there (the percentile bootstrap, both levels resampled, Student's interval looked at after
each episode until it is narrow); where values come in lumps, `least`, what any interval covers at
least (`evaluation_lattice.py`). The second line above makes the tables of
docs/reference/coverage.md of it, with all cells outside 93 and 97 %. The intervals are the
package's own, with 999 resamples in place of 4,999, for many experiments at once
(`evaluation_batch.py`).
"""

import argparse
import json
import time
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import evaluation_batch as batch
import numpy as np
from evaluation_draws import DRAWS, FRESH, MEANS, STOPPED, TAILS, Draw
from evaluation_lattice import of_estimates, of_iqm_of_two, of_quantile
from evaluation_tables import outside, table
from numpy.random import Generator

from gamekeeper.statistics import aggregates as environments_module
from gamekeeper.statistics import resampling
from gamekeeper.statistics.aggregates import (
    aggregate,
    improvement,
    over_environments,
    probability_of_improvement,
)
from gamekeeper.statistics.narrowing import Narrowing

Line = dict[str, Any]

BATCH = 100
"""Experiments that share their resamples."""
SOME = ("normal", "exponential", "log-normal 0.5", "Student's t, 3", "two peaks, 80 %")


@cache
def truths(draw: Draw) -> dict[str, float]:
    """Statistics of a distribution, from two million values, and the chances around its median."""
    values = np.sort(draw(np.random.default_rng(7), 2_000_000) * 1.0)
    median = values[1_000_000]
    return {
        "mean": float(values.mean()),
        "iqm": float(values[500_000:1_500_000].mean()),
        "median": float(median),
        "under": float(np.searchsorted(values, median, "left") / 2e6),
        "upto": float(np.searchsorted(values, median, "right") / 2e6),
    }


def truth(draw: Draw, statistic: str) -> float:
    """A statistic of the distribution."""
    return truths(draw)[statistic]


def held(low: Any, high: Any, value: float, slack: float = 1e-9) -> Any:
    """Whether intervals hold a value; NaN where there is none, as it was refused."""
    holds = (low - slack <= value) & (value <= high + slack)
    return np.where(np.isnan(low), np.nan, holds)


def percent(hits: Any) -> float | None:
    """The part that is true, of those that there are; None of fewer than one in ten."""
    there = np.asarray(hits)[~np.isnan(hits)]
    return round(100 * float(there.mean()), 1) if len(there) > len(hits) / 10 else None


def tally(hits: Any) -> dict[str, float]:
    """The parts that hold the truth, and that have no interval, where there are any."""
    found, part = percent(hits), round(100 * float(np.isnan(hits).mean()), 1)
    return ({} if found is None else {"held": found}) | ({"refused": part} if part else {})


def batches(seed: list[int], repeats: int) -> Iterator[tuple[Generator, int]]:
    """Experiments in batches, each with resamples of its own."""
    for start in range(0, repeats, BATCH):
        yield np.random.default_rng([*seed, start]), min(BATCH, repeats - start)


def floor_of(statistic: str, draw: Draw, n: int) -> dict[str, float]:
    """What any interval covers at least, where values come in lumps."""
    if draw is DRAWS["success, 80 %"] and statistic == "iqm":
        return {"least": round(of_iqm_of_two(n, 0.8), 1)}
    if statistic != "median":
        return {}
    under, upto = truth(draw, "under"), truth(draw, "upto")
    return {"least": round(of_quantile(n, 0.5, under, upto), 1)} if upto - under > 1e-4 else {}


def one_samples(
    unit: str,
    sizes: dict[str, tuple[int, ...]],
    seed: int,
    repeats: int,
    draws: Mapping[str, Draw] = DRAWS,
) -> Iterator[Line]:
    """Statistics of independent values; `usual` is the plain percentiles of the bootstrap."""
    for statistic, numbers in sizes.items():
        for name, draw in draws.items():
            value = MEANS.get(name) or truth(draw, statistic)
            for n in numbers:
                hits, usual = [], []
                for rng, many in batches([seed, n], repeats):
                    values, drawn = draw(rng, (many, n)) * 1.0, batch.counts(n, rng)
                    low, high = batch.one_sample(values, statistic, drawn)
                    hits.append(held(low, high, value, 1e-3))
                    plain = np.quantile(
                        batch.resampled(values, drawn, statistic), [0.025, 0.975], axis=1
                    )
                    usual.append(held(*plain, value, 1e-3))
                line = {"claim": f"{statistic} of {unit}", "of": name, "n": n}
                line |= tally(np.concatenate(hits)) | floor_of(statistic, draw, n)
                yield line | {"usual": percent(np.concatenate(usual))}


def episodes(repeats: int) -> Iterator[Line]:
    """Claims about one checkpoint, over its episodes."""
    sizes = {"mean": (100, 200), "iqm": (20, 50), "median": (10, 50)}
    yield from one_samples("episodes", sizes, 1, repeats)


def runs(repeats: int) -> Iterator[Line]:
    """Claims about a method, over the scores of its training runs."""
    sizes = {"mean": (30, 50), "iqm": (12, 20), "median": (10, 20)}
    yield from one_samples("runs", sizes, 3, repeats)


def fresh(repeats: int) -> Iterator[Line]:
    """Means and IQM at the fewest values, of distributions that no constant was chosen on."""
    asked = (("episodes", {"mean": (100,), "iqm": (20,)}), ("runs", {"mean": (30,), "iqm": (12,)}))
    for unit, sizes in asked:
        for line in one_samples(unit, sizes, 11, repeats, FRESH):
            yield {"held_fresh" if name == "held" else name: line[name] for name in line}


def tails(repeats: int) -> Iterator[Line]:
    """Means of values with tails as long as log-normal ones of sigma 2 have, and longer."""
    yield from one_samples("episodes", {"mean": (100, 200)}, 12, repeats, TAILS)
    yield from one_samples("runs", {"mean": (30, 50)}, 13, repeats, TAILS)


def quantiles(repeats: int) -> Iterator[Line]:
    """Quantiles of one checkpoint's episodes."""
    for part, n in ((0.25, 20), (0.05, 72), (0.95, 100)):
        for name in (*SOME, "counts, mean 1"):
            big = DRAWS[name](np.random.default_rng(7), 2_000_000)
            value = float(np.quantile(big, part, method="inverted_cdf"))
            under, upto = float(np.mean(big < value)), float(np.mean(big <= value))
            values = DRAWS[name](np.random.default_rng([2, n]), (repeats, n)) * 1.0
            line = {"claim": f"quantile {part}", "of": name, "n": n}
            hits = held(*batch.quantiles(values, part), value)
            line |= tally(hits)
            lump = upto - under > 1e-4
            yield line | ({"least": round(of_quantile(n, part, under, upto), 1)} if lump else {})


def both_levels(scores_re: Any, rng: Generator) -> tuple[float, float]:
    """Runs resampled, and the episodes within each: percentiles of the mean."""
    many, episodes = scores_re.shape
    row = rng.integers(0, many, (199, many, 1))
    column = rng.integers(0, episodes, (199, many, episodes))
    low, high = np.quantile(scores_re[row, column].mean(axis=(1, 2)), [0.025, 0.975])
    return float(low), float(high)


def hierarchy(repeats: int) -> Iterator[Line]:
    """Runs by episodes: how far runs lie apart, and whether they share their seeds.

    An episode's spread is 1; on shared seeds half of its variance is the seed's. `usual` is of 200
    experiments.
    """
    for shared in (False, True):
        for apart in (0.0, 0.1, 0.3, 1.0, 2.0):
            for statistic, n in {"mean": 30, "iqm": 12, "median": 10}.items():
                hits, usual = [], []
                for rng, many in batches([4, n], repeats):
                    seeds = rng.normal(0, 0.5**0.5, (many, 1, 30)) if shared else 0.0
                    rest = rng.normal(0, 0.5**0.5 if shared else 1.0, (many, n, 30))
                    scores = rng.normal(0, apart, (many, n, 1)) + seeds + rest
                    drawn = batch.counts(n, rng)
                    if shared:
                        found = batch.over_runs(scores, statistic, drawn)
                    else:
                        found = batch.one_sample(scores.mean(axis=2), statistic, drawn)
                    hits.append(held(*found, 0.0))
                    if statistic == "mean" and len(usual) < 200:
                        usual += [held(*both_levels(each, rng), 0.0) for each in scores]
                seeds_are = "shared" if shared else "own"
                line = {"claim": f"{statistic} of runs by episodes, {seeds_are} seeds"}
                line |= {"of": f"runs {apart} apart", "n": n}
                line["held"] = percent(np.concatenate(hits))
                yield line | ({"usual": percent(usual)} if usual else {})


def environments(repeats: int) -> Iterator[Line]:
    """Aggregates over environments; `usual` is the plain percentiles of the bootstrap."""
    cases = [("mean", 3, 10), ("mean", 10, 3), ("iqm", 3, 10), ("iqm", 6, 5), ("iqm", 10, 3)]
    cases += [("optimality_gap", 3, 10), ("optimality_gap", 10, 3), ("median", 4, 30)]
    for statistic, many, n in cases:
        for name in (*SOME, "shares, mean 0.8"):
            big = scores_of(DRAWS[name], np.random.default_rng(7), many, 300_000)
            value = aggregate(big, statistic=statistic)
            hits, usual = [], []
            for rng, rows in batches([5, n, many], repeats):
                scores = scores_of(DRAWS[name], rng, many, (rows, n))
                hits.append(held(*over(scores, statistic, rng), value))
                usual.append(held(*stratified_percentile(scores, statistic, rng), value))
            line = {"claim": f"{statistic} over {many} environments", "of": name, "n": n}
            line |= {"held": percent(np.concatenate(hits))}
            yield line | {"usual": percent(np.concatenate(usual))}


def scores_of(draw: Draw, rng: Generator, many: int, size: Any) -> dict[str, Any]:
    """Runs of several environments, which lie apart and spread differently."""
    steps = np.linspace(0, 1, many)
    return {f"env{k}": 0.3 * (0.5 + step) * draw(rng, size) + step for k, step in enumerate(steps)}


def over(scores: dict[str, Any], statistic: str, rng: Generator) -> tuple[Any, Any]:
    """The bounds of each experiment."""
    strata = list(scores.values())
    if statistic == "iqm":
        found = [
            over_environments(
                {name: each[row] for name, each in scores.items()}, statistic="iqm", rng=rng
            )
            for row in range(len(strata[0]))
        ]
        return np.array([each.low for each in found]), np.array([each.high for each in found])
    if statistic == "optimality_gap":
        strata = [1 - np.minimum(each, 1) for each in strata]
    drawn = [batch.counts(each.shape[1], rng) for each in strata]
    made = batch.environment_medians if statistic == "median" else batch.environment_means
    return made(strata, drawn)


def stratified_percentile(scores: dict[str, Any], statistic: str, rng: Generator) -> Any:
    """The usual interval over environments: plain percentiles, runs resampled in each."""
    strata = list(scores.values())
    if statistic == "iqm":  # by index, because the order of all scores differs by experiment
        places = [rng.integers(0, each.shape[1], (199, each.shape[1])) for each in strata]
        drawn = [each[:, place] for each, place in zip(strata, places, strict=True)]
        found = resampling.middle(np.concatenate(drawn, axis=2)).mean(axis=2)
        return np.quantile(found, [0.025, 0.975], axis=1)
    if statistic == "optimality_gap":
        strata = [1 - np.minimum(each, 1) for each in strata]
    means = [batch.resampled(each, batch.counts(each.shape[1], rng), "mean") for each in strata]
    found = np.median(means, axis=0) if statistic == "median" else np.mean(means, axis=0)
    return np.quantile(found, [0.025, 0.975], axis=1)


def beats(repeats: int) -> Iterator[Line]:
    """The probability of improvement, and differences of methods."""
    for name in (*SOME, "shares, mean 0.8", "counts, mean 1", "success, 80 %"):
        for shift in (0.0,) if name.startswith("success") else (0.0, 0.8):
            big = [DRAWS[name](np.random.default_rng(k), 200_000) for k in (7, 8)]
            value = probability_of_improvement(big[0] + shift, big[1])
            yield from one_improvement(name, shift, value, repeats)
            yield one_difference(name, shift, repeats)


def one_improvement(name: str, shift: float, value: float, repeats: int) -> Iterator[Line]:
    """Of one distribution against itself, shifted."""
    of = f"{name}, + {shift}" if shift else name
    for paired, n, many in ((False, 10, 1), (False, 10, 4), (True, 50, 1), (True, 100, 1)):
        hits, estimates = [], []
        for repeat in range(repeats):
            rng = np.random.default_rng([6, n, many, repeat])
            a, b = DRAWS[name](rng, (many, n)) + shift, DRAWS[name](rng, (many, n))
            one = {str(k): row for k, row in enumerate(a)}
            found = improvement(one, {str(k): row for k, row in enumerate(b)}, paired=paired)
            hits.append(held(found.low, found.high, value, 1e-3))
            estimates.append(found.value)
        unit = "paired episodes" if paired else "runs" + (f", {many} environments" * (many > 1))
        line = {"claim": f"improvement over {unit}", "of": of, "n": n, "held": percent(hits)}
        least = of_estimates(estimates, value) if many == 1 else 0.0
        yield line | ({"least": round(least, 1)} if least > 97 else {})


def one_difference(name: str, shift: float, repeats: int) -> Line:
    """Of two methods' means; the other has half the spread."""
    mean = truth(DRAWS[name], "mean")
    hits = []
    for rng, many in batches([7], repeats):
        a = DRAWS[name](rng, (many, 10)) * 1.0
        b = 0.5 * (DRAWS[name](rng, (many, 10)) - mean) + mean + shift
        drawn = [batch.counts(10, rng), batch.counts(10, rng)]
        hits.append(held(*batch.differences(a, b, drawn), shift, 1e-3))
    line = {"claim": "difference over runs", "of": f"{name}, + {shift}" if shift else name, "n": 10}
    return line | tally(np.concatenate(hits))


def stopping(repeats: int) -> Iterator[Line]:
    """Played until the interval is narrow enough, or 1,000 episodes; `stopped` is the mean n.

    `usual` is Student's interval looked at from 10 episodes on.
    """
    for name, draw in STOPPED.items():
        for line, width, bounded in widths_of(name, draw):
            kind = Narrowing(0.0, 1.0) if bounded else Narrowing()
            mean, hits, usual, stops = truth(draw, "mean"), [], [], []
            for repeat in range(repeats):
                values = draw(np.random.default_rng([8, repeat]), 300 if bounded else 1_000) * 1.0
                stop, hit = stopped(*kind.sequence(values), width, mean)
                stops.append(stop)
                hits.append(hit)
                usual.append(stopped(*students(values), width, mean)[1])
            line |= {"claim": f"until narrow, {line['claim']}", "held": percent(hits)}
            yield line | {"usual": percent(usual), "stopped": round(float(np.mean(stops)))}


def widths_of(name: str, draw: Draw) -> Iterator[tuple[Line, float, bool]]:
    """The widths asked for of one distribution."""
    big = draw(np.random.default_rng(7), 2_000_000)
    if big.min() >= 0.0 and big.max() <= 1.0:
        yield {"claim": "bounded, width 0.25", "of": name}, 0.25, True
        return
    for width in (0.6, 0.35):
        claim = f"unbounded, width {width} sd"
        yield {"claim": claim, "of": name}, width * float(big.std()), False


def stopped(low: Any, high: Any, width: float, mean: float) -> tuple[int, bool]:
    """Where an interval is narrow for the first time, else the last, and whether it holds."""
    narrow = np.flatnonzero(high - low <= width)
    stop = int(narrow[0]) if len(narrow) else len(low) - 1
    return stop + 1, bool(held(low[stop], high[stop], mean, 1e-3))


def students(values: Any) -> tuple[Any, Any]:
    """The usual interval after each value."""
    n = np.arange(1, len(values) + 1)
    centre = np.cumsum(values) / n
    spread = np.sqrt(np.maximum(np.cumsum(values**2) / n - centre**2, 0))
    reach = 1.96 * spread / np.sqrt(np.maximum(n - 1, 1))
    reach[:9] = np.inf
    return centre - reach, centre + reach


PARTS = {
    "episodes": episodes,
    "quantiles": quantiles,
    "runs": runs,
    "hierarchy": hierarchy,
    "environments": environments,
    "beats": beats,
    "stopping": stopping,
    "fresh": fresh,
    "tails": tails,
}


def main() -> None:
    """Prints the lines."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="60 repetitions")
    parser.add_argument("--only", choices=PARTS, action="append", help="these parts alone")
    parser.add_argument("--repeats", type=int, default=2_000)
    parser.add_argument("--table", type=Path, help="tables of lines that were printed before")
    options = parser.parse_args()
    if options.table:
        lines = [json.loads(line) for line in options.table.read_text().splitlines()]
        print("\n".join([*table(lines), *outside(lines)]))
        return
    for module in (resampling, environments_module):
        module.RESAMPLES = 999
    batch.same()
    for part in options.only or PARTS:
        for line in PARTS[part](60 if options.quick else options.repeats):
            spent = {"seconds": round(time.process_time(), 1)}
            print(json.dumps({"part": part} | line | spent), flush=True)


if __name__ == "__main__":
    main()
