"""Effects over paired episodes: a mean difference with an interval that covers as it says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import comb, copysign, inf, sqrt
from statistics import NormalDist
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.errors import EvidenceError

FloatArray = NDArray[np.float64]

FEWEST: Final = 50
"""Pairs below which no interval is claimed: its coverage isn't what it says."""
_RESAMPLES: Final = 4_999
"""Bootstrap resamples; the least p-value is then 2 / 5,000."""
_CHUNK: Final = 2**21
"""Numbers that are drawn at once, to bound memory."""
_LONGEST: Final = 1.45
"""A bound is at most so many times as far out as Student's. Resamples of a few rare values have
next to no spread, and a quantile of their t is then any number; found by simulation, like the
halves below (benchmarks/interval_coverage.py)."""
_HALVINGS: Final = 60


@dataclass(frozen=True, slots=True)
class Effect:
    """A mean difference over paired episodes.

    Attributes:
        value: mean of changed - base.
        low: lower bound of its interval.
        high: upper bound.
        p: of the mean difference being 0, two-sided.
        n: pairs.
    """

    value: float
    low: float
    high: float
    p: float
    n: int

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "p": self.p,
            "n": self.n,
        }


def paired_effect(
    base: FloatArray, changed: FloatArray, *, rng: Generator, level: float = 0.95
) -> Effect:
    """Mean of `changed - base` over paired episodes, with an interval.

    Differences that are all -1, 0 or 1 (two ways to fail or succeed) get Tango's score interval
    and McNemar's exact p. Others get a bootstrap-t interval half way between the equal-tailed one,
    which follows a skew, and the symmetric one, which bears few distinct values; its p-value is
    the least for which the interval leaves 0 out, and no less than 2 / 5,000. Where all
    differences are one number nothing is known of their spread, and the interval is that number.

    Args:
        base: [episodes] a figure of each episode, unchanged, in its own units.
        changed: [episodes] the same seeds in the same order.
        rng: draws the resamples.
        level: coverage of the interval, in [0.8, 0.999].
    Raises:
        EvidenceError: there are fewer than `FEWEST` pairs, the lengths differ, or a figure isn't
            finite.
    Source: Tango 1998, "Equivalence test and confidence interval for the difference in proportions
        for the paired-sample design"; McNemar 1947; Efron & Tibshirani 1993, ch. 12.5
        (bootstrap-t); Hall 1988, "On symmetric bootstrap confidence intervals".
    """
    differences = _differences(base, changed, level)
    n, value = len(differences), float(differences.mean())
    if np.isin(differences, (-1.0, 0.0, 1.0)).all():
        more, less = int((differences == 1).sum()), int((differences == -1).sum())
        low, high = _tango(more, less, n, level)
        return Effect(value, low, high, _mcnemar(more, less), n)
    spread = float(differences.std(ddof=1))
    if spread <= 1e-12 * float(np.abs(differences).max()):
        return Effect(value, value, value, 1.0 if value == 0 else 2.0 ** (1 - n), n)
    error = spread / sqrt(n)
    bounds = _bootstrap_t((differences - value) / spread, rng)
    least, most = bounds(level)
    return Effect(value, value - most * error, value - least * error, _p(bounds, value / error), n)


def _differences(base: FloatArray, changed: FloatArray, level: float) -> FloatArray:
    one, two = np.asarray(base, np.float64), np.asarray(changed, np.float64)
    if one.ndim != 1 or one.shape != two.shape:
        raise EvidenceError(
            "two arms can't be paired",
            where="paired_effect",
            expected="[episodes] twice, equally many",
            seen=f"{one.shape} and {two.shape}",
        )
    if len(one) < FEWEST:
        raise EvidenceError(
            "too few pairs for an interval that covers as it says",
            where="paired_effect",
            expected=f"at least {FEWEST} pairs",
            seen=str(len(one)),
            mend="play more episodes",
        )
    if not 0.8 <= level <= 0.999:
        raise EvidenceError(
            "no interval of this level",
            where="paired_effect",
            expected="level in [0.8, 0.999]",
            seen=str(level),
        )
    differences = two - one
    if not np.isfinite(differences).all():
        raise EvidenceError(
            "a figure isn't finite",
            where="paired_effect",
            expected="finite numbers",
            seen=f"pair {int(np.flatnonzero(~np.isfinite(differences))[0])}",
        )
    return differences


def _tango(more: int, less: int, n: int, level: float) -> tuple[float, float]:
    """The differences of proportions that a score test doesn't reject."""
    z = NormalDist().inv_cdf(0.5 + level / 2)
    value = (more - less) / n

    def score(truth: float) -> float:
        a, b = 2 * n, (2 * n - more + less) * truth - more - less
        less_share = (sqrt(max(b * b + 4 * a * less * truth * (1 - truth), 0.0)) - b) / (2 * a)
        variance = n * (2 * less_share + truth * (1 - truth))
        off = more - less - n * truth
        return off / sqrt(variance) if variance > 0 else copysign(inf, off)

    low = -1.0 if value == -1 else _crossing(lambda truth: score(truth) > z, -1.0, value)
    high = 1.0 if value == 1 else _crossing(lambda truth: score(truth) > -z, value, 1.0)
    return low, high


def _mcnemar(more: int, less: int) -> float:
    """The exact p-value of both ways to differ being equally likely."""
    pairs = more + less
    tail = sum(comb(pairs, k) for k in range(min(more, less) + 1))
    return float(min(2 * tail / 2**pairs, 1.0))


def _bootstrap_t(values: FloatArray, rng: Generator) -> Callable[[float], tuple[float, float]]:
    """The quantiles of t, least and most, by level; of values with mean 0 and spread 1."""
    n = len(values)
    t = np.empty(_RESAMPLES)
    step = max(_CHUNK // n, 1)
    for start in range(0, _RESAMPLES, step):
        drawn = values[rng.integers(0, n, (min(step, _RESAMPLES - start), n))]
        mean = drawn.mean(axis=1)
        variance = np.einsum("ij,ij->i", drawn, drawn) / n - mean * mean
        t[start : start + step] = mean * sqrt(n - 1) / np.sqrt(np.maximum(variance, 1e-12))
    t.sort()
    sizes = np.sort(np.abs(t))

    def bounds(level: float) -> tuple[float, float]:
        both = _at(sizes, level)
        farthest = _LONGEST * student(level, n - 1)
        most = (_at(t, 0.5 + level / 2) + both) / 2
        least = (_at(t, 0.5 - level / 2) - both) / 2
        return max(least, -farthest), min(most, farthest)

    return bounds


def _p(bounds: Callable[[float], tuple[float, float]], t: float) -> float:
    """One minus the highest level whose interval leaves 0 out."""

    def leaves_out(level: float) -> bool:
        least, most = bounds(level)
        return not least <= t <= most

    return max(1 - _crossing(leaves_out, 0.0, 1.0 - 1e-9), 2 / (_RESAMPLES + 1))


def student(level: float, freedom: int) -> float:
    """How many standard errors Student's interval of a level reaches, for 30 degrees and more.

    Source: Abramowitz & Stegun 1964, 26.7.5.
    """
    z = NormalDist().inv_cdf(0.5 + level / 2)
    first = (z**3 + z) / 4
    second = (5 * z**5 + 16 * z**3 + 3 * z) / 96
    return z + first / freedom + second / freedom**2


def _at(ordered: FloatArray, part: float) -> float:
    """A quantile of sorted values."""
    place = part * (len(ordered) - 1)
    under = int(place)
    above = min(under + 1, len(ordered) - 1)
    return float(ordered[under] + (place - under) * (ordered[above] - ordered[under]))


def _crossing(is_before: Callable[[float], bool], low: float, high: float) -> float:
    """Where a claim that holds at first stops to hold."""
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if is_before(middle) else (low, middle)
    return (low + high) / 2
