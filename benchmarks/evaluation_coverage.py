"""How often the intervals of evaluation hold the truth, by simulation, at the n each asks for.

    python benchmarks/evaluation_coverage.py [--quick] [--only PART] > coverage.jsonl
    python benchmarks/evaluation_coverage.py --table coverage.jsonl

Prints a JSON line for each claim, distribution and n: `held`, the part of the simulated experiments
whose 95 % interval holds the truth (in percent), and, where there is one, `usual`, what the usual
way holds there: the percentile bootstrap for runs, both levels resampled, Student's interval looked
at after each episode until it is narrow. The second line above makes the tables of
docs/statistics.md of it. The intervals are the package's own, with 999 resamples in place of 4,999.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from gamekeeper.core.evaluation import bootstrap, iqm, strata
from gamekeeper.core.evaluation import environments as environments_module
from gamekeeper.core.evaluation.confidence_sequence import ConfidenceSequence
from gamekeeper.core.evaluation.environments import aggregate, over_environments
from gamekeeper.core.evaluation.improvement import improvement, probability_of_improvement
from gamekeeper.core.evaluation.one_sample import one_sample
from gamekeeper.core.evaluation.order_statistics import quantile
from gamekeeper.core.evaluation.runs import difference_over_runs, over_runs

Draw = Callable[[Generator, Any], Any]
Line = dict[str, Any]


def two_peaks(high: float, spread: float) -> Draw:
    """Values around 0, and so many of them around 5."""
    return lambda rng, size: 5.0 * (rng.random(size) < high) + rng.normal(0, spread, size)


DRAWS: dict[str, Draw] = {
    "normal": lambda rng, size: rng.normal(0, 1, size),
    "uniform": lambda rng, size: rng.random(size),
    "exponential": lambda rng, size: rng.exponential(1, size),
    "log-normal 0.5": lambda rng, size: rng.lognormal(0, 0.5, size),
    "log-normal 1": lambda rng, size: rng.lognormal(0, 1, size),
    "log-normal 2": lambda rng, size: rng.lognormal(0, 2, size),
    "Student's t, 3": lambda rng, size: rng.standard_t(3, size),
    "two peaks, even": two_peaks(0.5, 1),
    "two peaks, 80 %": two_peaks(0.8, 1),
    "success, 80 %": lambda rng, size: (rng.random(size) < 0.8) * 1.0,
    "shares, mean 0.8": lambda rng, size: rng.binomial(50, rng.beta(4, 1, size)) / 50,
    "shares, mean 0.95": lambda rng, size: rng.binomial(50, rng.beta(19, 1, size)) / 50,
    "counts, mean 1": lambda rng, size: rng.poisson(1, size) * 1.0,
    "deliveries and energy": lambda rng, size: (
        5.0 * rng.binomial(8, 0.7, size) - 0.01 * rng.normal(100, 30, size)
    ),
    "60 % zeros": lambda rng, size: rng.choice([0.0, 1.0, 2.0], p=[0.6, 0.2, 0.2], size=size),
}
STOPPED: dict[str, Draw] = DRAWS | {
    "success, 50 %": lambda rng, size: (rng.random(size) < 0.5) * 1.0,
    "5 in 3 % of episodes": lambda rng, size: (rng.random(size) < 0.03) * 5.0,
}
SOME = ("normal", "exponential", "log-normal 0.5", "Student's t, 3", "two peaks, 80 %")


@cache
def truth(draw: Draw, statistic: str) -> float:
    """A statistic of the distribution, from two million values."""
    values = np.sort(draw(np.random.default_rng(7), 2_000_000))
    if statistic == "median":
        return float(values[1_000_000])
    kept = values[500_000:1_500_000] if statistic == "iqm" else values
    return float(kept.mean())


def held(low: float, high: float, value: float, slack: float = 1e-9) -> bool:
    """Whether an interval holds a value."""
    return low - slack <= value <= high + slack


def percent(hits: list[bool]) -> float:
    """The part that is true."""
    return round(100 * float(np.mean(hits)), 1)


def episodes(repeats: int) -> Iterator[Line]:
    """Claims about one checkpoint, over its episodes."""
    for statistic, sizes in {"mean": (50, 100), "iqm": (20, 50), "median": (10, 50)}.items():
        for name, draw in DRAWS.items():
            value = truth(draw, statistic)
            for n in sizes:
                hits = []
                for repeat in range(repeats):
                    rng = np.random.default_rng([1, n, repeat])
                    found = one_sample(draw(rng, n), statistic=statistic, rng=rng)
                    hits.append(held(found.low, found.high, value, 1e-3))
                yield {
                    "claim": f"{statistic} of episodes",
                    "of": name,
                    "n": n,
                    "held": percent(hits),
                }


def quantiles(repeats: int) -> Iterator[Line]:
    """Quantiles of one checkpoint's episodes."""
    for part, n in ((0.25, 20), (0.05, 72), (0.95, 100)):
        for name in (*SOME, "counts, mean 1"):
            big = DRAWS[name](np.random.default_rng(7), 2_000_000)
            value = float(np.quantile(big, part, method="inverted_cdf"))
            hits = []
            for repeat in range(repeats):
                found = quantile(DRAWS[name](np.random.default_rng([2, n, repeat]), n), part)
                hits.append(held(found.low, found.high, value))
            yield {"claim": f"quantile {part}", "of": name, "n": n, "held": percent(hits)}


def percentile(values: Any, statistic: str, rng: Generator) -> tuple[float, float]:
    """The usual interval over runs: plain percentiles of the resampled statistic."""
    drawn = values[rng.integers(0, len(values), (999, len(values)))]
    kept = iqm.middle(drawn) if statistic == "iqm" else drawn
    made = np.median(drawn, axis=1) if statistic == "median" else kept.mean(axis=1)
    low, high = np.quantile(made, [0.025, 0.975])
    return float(low), float(high)


def runs(repeats: int) -> Iterator[Line]:
    """Claims about a method, over the scores of its training runs."""
    for statistic in ("mean", "iqm", "median"):
        for name, draw in DRAWS.items():
            value = truth(draw, statistic)
            for n in (10, 20):
                hits, usual = [], []
                for repeat in range(repeats):
                    rng = np.random.default_rng([3, n, repeat])
                    values = draw(rng, n)
                    found = over_runs(values, statistic=statistic, rng=rng)
                    hits.append(held(found.low, found.high, value, 1e-3))
                    usual.append(held(*percentile(values, statistic, rng), value, 1e-3))
                line = {"claim": f"{statistic} of runs", "of": name, "n": n}
                yield line | {"held": percent(hits), "usual": percent(usual)}


def both_levels(scores_re: Any, rng: Generator) -> tuple[float, float]:
    """Runs resampled, and the episodes within each: percentiles of the mean."""
    many, episodes = scores_re.shape
    row = rng.integers(0, many, (499, many, 1))
    column = rng.integers(0, episodes, (499, many, episodes))
    low, high = np.quantile(scores_re[row, column].mean(axis=(1, 2)), [0.025, 0.975])
    return float(low), float(high)


def hierarchy(repeats: int) -> Iterator[Line]:
    """Runs by episodes: how far runs lie apart, and whether they share their seeds.

    An episode's spread is 1; on shared seeds half of its variance is the seed's.
    """
    for shared in (False, True):
        for apart in (0.0, 0.1, 0.3, 1.0, 2.0):
            for statistic in ("mean", "iqm", "median"):
                hits, usual = [], []
                for repeat in range(repeats):
                    rng = np.random.default_rng([4, repeat])
                    seeds = rng.normal(0, 0.5**0.5, 30) if shared else np.zeros(30)
                    rest = rng.normal(0, 0.5**0.5 if shared else 1.0, (10, 30))
                    scores = rng.normal(0, apart, (10, 1)) + seeds + rest
                    found = over_runs(scores, statistic=statistic, shared_seeds=shared, rng=rng)
                    hits.append(held(found.low, found.high, 0.0))
                    if statistic == "mean":
                        usual.append(held(*both_levels(scores, rng), 0.0))
                seeds_are = "shared" if shared else "own"
                line = {"claim": f"{statistic} of runs by episodes, {seeds_are} seeds"}
                line |= {"of": f"runs {apart} apart", "n": 10, "held": percent(hits)}
                yield line | ({"usual": percent(usual)} if usual else {})


def scores_of(draw: Draw, rng: Generator, many: int, n: int) -> dict[str, Any]:
    """Runs of several environments, which lie apart and spread differently."""
    steps = np.linspace(0, 1, many)
    return {f"env{k}": 0.3 * (0.5 + step) * draw(rng, n) + step for k, step in enumerate(steps)}


def environments(repeats: int) -> Iterator[Line]:
    """Aggregates over environments."""
    cases = [("mean", 3, 10), ("mean", 10, 3), ("iqm", 3, 10), ("iqm", 6, 5), ("iqm", 10, 3)]
    cases += [("optimality_gap", 3, 10), ("optimality_gap", 10, 3), ("median", 4, 20)]
    for statistic, many, n in cases:
        for name in (*SOME, "shares, mean 0.8"):
            big = scores_of(DRAWS[name], np.random.default_rng(7), many, 300_000)
            value = aggregate(big, statistic=statistic)
            hits, usual = [], []
            for repeat in range(repeats):
                rng = np.random.default_rng([5, n, many, repeat])
                scores = scores_of(DRAWS[name], rng, many, n)
                found = over_environments(scores, statistic=statistic, rng=rng)
                hits.append(held(found.low, found.high, value))
                low, high = stratified_percentile(scores, statistic, rng)
                usual.append(held(low, high, value))
            line = {"claim": f"{statistic} over {many} environments", "of": name, "n": n}
            yield line | {"held": percent(hits), "usual": percent(usual)}


def stratified_percentile(scores: dict[str, Any], statistic: str, rng: Generator) -> Any:
    """The usual interval over environments: plain percentiles, runs resampled in each."""
    drawn = np.stack(
        [each[rng.integers(0, len(each), (499, len(each)))] for each in scores.values()]
    )
    if statistic == "iqm":
        found = iqm.middle(np.concatenate(list(drawn), axis=1)).mean(axis=1)
    elif statistic == "median":
        found = np.median(drawn.mean(axis=2), axis=0)
    else:
        found = (1 - np.minimum(drawn, 1) if statistic != "mean" else drawn).mean(axis=(0, 2))
    return np.quantile(found, [0.025, 0.975])


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
    for paired, n, many in ((False, 10, 1), (False, 10, 4), (True, 20, 1), (True, 50, 1)):
        hits = []
        for repeat in range(repeats):
            rng = np.random.default_rng([6, n, many, repeat])
            a, b = DRAWS[name](rng, (many, n)) + shift, DRAWS[name](rng, (many, n))
            one = {str(k): row for k, row in enumerate(a)}
            found = improvement(one, {str(k): row for k, row in enumerate(b)}, paired=paired)
            hits.append(held(found.low, found.high, value, 1e-3))
        unit = "paired episodes" if paired else "runs" + (f", {many} environments" * (many > 1))
        yield {"claim": f"improvement over {unit}", "of": of, "n": n, "held": percent(hits)}


def one_difference(name: str, shift: float, repeats: int) -> Line:
    """Of two methods' means; the other has half the spread."""
    mean = truth(DRAWS[name], "mean")
    hits, found_p = [], []
    for repeat in range(repeats):
        rng = np.random.default_rng([7, repeat])
        a, b = DRAWS[name](rng, 10), 0.5 * (DRAWS[name](rng, 10) - mean) + mean + shift
        found = difference_over_runs(a, b, rng=rng)
        hits.append(held(found.low, found.high, shift, 1e-3))
        found_p.append(found.p <= 0.05)
    line = {"claim": "difference over runs", "of": f"{name}, + {shift}" if shift else name, "n": 10}
    return line | {"held": percent(hits)} | ({} if shift else {"p <= 0.05": percent(found_p)})


def stopping(repeats: int) -> Iterator[Line]:
    """Played until the interval is narrow enough, or 3,000 episodes; `stopped` is the mean n."""
    for name, draw in STOPPED.items():
        big = draw(np.random.default_rng(7), 2_000_000)
        bounded = big.min() >= 0.0 and big.max() <= 1.0
        sequence = ConfidenceSequence(0.0, 1.0) if bounded else ConfidenceSequence()
        for width in (0.25,) if bounded else (0.6, 0.35):
            of = f"{'bounded' if bounded else 'unbounded'}, width {width}{'' if bounded else ' sd'}"
            spread = 1.0 if bounded else float(big.std())
            line = one_stop(draw, sequence, width * spread, repeats)
            yield {"claim": of, "of": name} | line


def one_stop(draw: Draw, sequence: ConfidenceSequence, width: float, most: int) -> Line:
    """Of one distribution, beside Student's interval looked at from 10 episodes on."""
    mean, hits, usual, stops = truth(draw, "mean"), [], [], []
    longest = 3_000 if sequence.least is None else 600
    for repeat in range(most if sequence.least is None else most // 4):
        values = draw(np.random.default_rng([8, repeat]), longest)
        low, high = sequence.sequence(values)
        stop = int(np.argmax(high - low <= width)) or longest - 1
        hits.append(held(low[stop], high[stop], mean))
        stops.append(stop + 1)
        n = np.arange(1, longest + 1)
        centre = np.cumsum(values) / n
        spread = np.sqrt(np.maximum(np.cumsum(values**2) / n - centre**2, 0))
        reach = 1.96 * spread / np.sqrt(np.maximum(n - 1, 1))
        reach[:9] = np.inf
        stop = int(np.argmax(2 * reach <= width))
        usual.append(abs(centre[stop] - mean) <= reach[stop])
    stopped = round(float(np.mean(stops)))
    return {"held": percent(hits), "usual": percent(usual), "stopped": stopped}


PARTS = {
    "episodes": episodes,
    "quantiles": quantiles,
    "runs": runs,
    "hierarchy": hierarchy,
    "environments": environments,
    "beats": beats,
    "stopping": stopping,
}


def table(lines: list[Line]) -> Iterator[str]:
    """Markdown: a table for each part, a distribution a row, a claim and n a column."""
    for part in dict.fromkeys(line["part"] for line in lines):
        mine = [line for line in lines if line["part"] == part]
        columns = list(dict.fromkeys(map(heading, mine)))
        cells = {(line["of"], heading(line)): cell(line) for line in mine}
        yield f"\n**{part}**\n\n| | {' | '.join(columns)} |\n|---|{'---|' * len(columns)}"
        for of in dict.fromkeys(line["of"] for line in mine):
            yield f"| {of} | {' | '.join(cells.get((of, key), '') for key in columns)} |"


def heading(line: Line) -> str:
    """What a column is of."""
    return line["claim"] + (f", n = {line['n']}" if "n" in line else "")


def cell(line: Line) -> str:
    """The coverage; what the usual interval covers in brackets; where it stopped."""
    usual = f" ({line['usual']})" if "usual" in line else ""
    return f"{line['held']}{usual}" + (f" at {line['stopped']}" if "stopped" in line else "")


def main() -> None:
    """Prints the lines."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="60 repetitions")
    parser.add_argument("--only", choices=PARTS, action="append", help="these parts alone")
    parser.add_argument("--repeats", type=int, default=700)
    parser.add_argument("--table", type=Path, help="tables of lines that were printed before")
    options = parser.parse_args()
    if options.table:
        lines = [json.loads(line) for line in options.table.read_text().splitlines()]
        print("\n".join(table(lines)))
        return
    for module in (bootstrap, iqm, strata, environments_module):
        module.RESAMPLES = 999
    for part in options.only or PARTS:
        for line in PARTS[part](60 if options.quick else options.repeats):
            spent = {"seconds": round(time.process_time(), 1)}
            print(json.dumps({"part": part} | line | spent), flush=True)


if __name__ == "__main__":
    main()
