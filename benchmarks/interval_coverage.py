"""How often intervals of paired effects hold the true effect, by simulation.

    python benchmarks/interval_coverage.py [--quick]

Prints a JSON line for each truth and number of pairs: the part of 1,000 simulated experiments whose
95 % interval holds the truth (in percent), and the part whose p-value is at most 0.05 where the
truth is 0. Differences with few, tied, skewed and rare values stand among the truths because
outcomes of episodes are such.
"""

import argparse
import json
from collections.abc import Callable
from typing import Any

import evaluation_batch as batch
import numpy as np
from numpy.random import Generator

from gamekeeper.statistics.paired import paired_effect

BATCH = 100
"""Experiments that share their resamples."""
Draw = Callable[[Generator, int], Any]


def binary(better: float, worse: float) -> tuple[Draw, float]:
    """Outcomes that are 0 or 1."""
    chances = [worse, 1 - better - worse, better]
    return lambda rng, n: rng.choice([-1.0, 0.0, 1.0], p=chances, size=n), better - worse


def rare(values: list[float], chances: list[float]) -> tuple[Draw, float]:
    """Differences that are mostly 0."""
    whole = [1 - sum(chances), *chances]
    mean = float(np.dot(values, chances))
    return lambda rng, n: rng.choice([0.0, *values], p=whole, size=n), mean


TRUTHS: dict[str, tuple[Draw, float]] = {
    "binary, 30 % better, 10 % worse": binary(0.3, 0.1),
    "binary, 10 % better, 5 % worse": binary(0.1, 0.05),
    "binary, 20 % either way": binary(0.2, 0.2),
    "binary, 5 % either way": binary(0.05, 0.05),
    "binary, 50 % better, 10 % worse": binary(0.5, 0.1),
    "normal, mean 0.3": (lambda rng, n: rng.normal(0.3, 1, n), 0.3),
    "normal, mean 0": (lambda rng, n: rng.normal(0, 1, n), 0.0),
    "Student's t with 3 degrees": (lambda rng, n: rng.standard_t(3, n), 0.0),
    "exponential (skewness 2)": (lambda rng, n: rng.exponential(1, n), 1.0),
    "log-normal 0.7 (skewness 2.9)": (lambda rng, n: rng.lognormal(0, 0.7, n), np.exp(0.245)),
    "log-normal 1 (skewness 6.2)": (lambda rng, n: rng.lognormal(0, 1, n), np.exp(0.5)),
    "difference of two log-normals": (
        lambda rng, n: rng.lognormal(0, 0.7, n) - 1.2 * rng.lognormal(0, 0.7, n),
        -0.2 * np.exp(0.245),
    ),
    "whole numbers, -2 to 3": (lambda rng, n: rng.integers(-2, 4, n) * 1.0, 0.5),
    "counts, Poisson 0.3": (lambda rng, n: -rng.poisson(0.3, n) * 1.0, -0.3),
    "deliveries and energy": (
        lambda rng, n: (
            5.0 * (rng.binomial(8, 0.7, n) - rng.binomial(8, 0.6, n))
            - 0.01 * rng.normal(100, 30, n)
        ),
        3.0,
    ),
    "80 % zeros": rare([1.0, -1.0, 2.0], [0.1, 0.05, 0.05]),
    "90 % zeros, one way": rare([1.0, 2.0], [0.05, 0.05]),
    "90 % zeros, either way": rare([1.0, -1.0, 2.0, -2.0], [0.025] * 4),
    "10 % far off": (lambda rng, n: rng.normal(0, 0.3, n) - 5 * (rng.random(n) < 0.1), -0.5),
}


def coverage(draw: Draw, truth: float, n: int, repeats: int) -> dict[str, Any]:
    """How one truth is covered; p is at most 0.05 where the interval leaves 0 out."""
    values = np.stack([draw(np.random.default_rng([n, k]), n) for k in range(repeats)])
    low, high = np.empty(repeats), np.empty(repeats)
    of_one = np.array([len(np.unique(np.abs(row[row != 0]))) < 2 for row in values])
    for k in np.flatnonzero(of_one):  # Tango's: nothing is resampled
        effect = paired_effect(np.zeros(n), values[k], rng=np.random.default_rng(k))
        low[k], high[k] = effect.low, effect.high
    for start in range(0, repeats, BATCH):
        part = np.flatnonzero(~of_one[start : start + BATCH]) + start
        if len(part):
            drawn = batch.counts(n, np.random.default_rng([n, start]))
            low[part], high[part] = batch.means(values[part], drawn)
    held = (low - 1e-9 <= truth) & (truth <= high + 1e-9)
    answer = {"pairs": n, "repeats": repeats, "held": round(100 * float(held.mean()), 1)}
    found = (low > 0) | (high < 0)
    return answer | ({"found": round(100 * float(found.mean()), 1)} if truth == 0 else {})


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="20 repetitions")
    repeats = 20 if parser.parse_args().quick else 1000
    for n in (50, 100, 200):
        for name, (draw, truth) in TRUTHS.items():
            print(json.dumps({"truth": name, **coverage(draw, truth, n, repeats)}), flush=True)


if __name__ == "__main__":
    main()
