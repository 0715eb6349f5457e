"""Resampling: bootstrap-t half way between its two kinds, and the t-expanded percentile interval.

Which is used where, and from how few values on, was found by simulation
(benchmarks/evaluation_coverage.py, benchmarks/interval_coverage.py).
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.core.evaluation.student import normal_tail, student

FloatArray = NDArray[np.float64]
Reach = Callable[[float], tuple[float, float]]
"""By level: the least and the most that t is, in standard errors."""

RESAMPLES: Final = 4_999
"""Bootstrap resamples; the least p-value is then 2 / 5,000."""
CHUNK: Final = 2**21
"""Numbers that are drawn at once, to bound memory."""
_LONGEST: Final = 1.45
"""A bound is at most so many times as far out as Student's. Resamples of a few rare values have
next to no spread, and a quantile of their t is then any number; found by simulation, like the
halves below."""
_LEAST_VARIANCE: Final = 1e-12
"""Of a resample, where the sample's is about 1: t stays a number, and `_LONGEST` bounds it."""


def t_of_means(values: FloatArray, rng: Generator) -> FloatArray:
    """Student's t of resamples' means.

    Args:
        values: [n] with mean 0 and spread 1.
        rng: draws the resamples.
    Returns:
        [resamples], not sorted.
    """
    n = len(values)
    t = np.empty(RESAMPLES)
    step = max(CHUNK // n, 1)
    for start in range(0, RESAMPLES, step):
        drawn = values[rng.integers(0, n, (min(step, RESAMPLES - start), n))]
        mean = drawn.mean(axis=1)
        variance = np.einsum("ij,ij->i", drawn, drawn) / n - mean * mean
        t[start : start + step] = (
            mean * sqrt(n - 1) / np.sqrt(np.maximum(variance, _LEAST_VARIANCE))
        )
    return t


def reach(t: FloatArray, freedom: float) -> Reach:
    """How far t goes either way, half way between the equal-tailed and the symmetric interval.

    The equal-tailed one follows a skew, the symmetric one bears few distinct values.

    Args:
        t: [resamples] of Student's t.
        freedom: its degrees.
    Source: Efron & Tibshirani 1993, ch. 12.5 (bootstrap-t); Hall 1988, "On symmetric bootstrap
        confidence intervals".
    """
    ordered, sizes = np.sort(t), np.sort(np.abs(t))

    def bounds(level: float) -> tuple[float, float]:
        both = float(at(sizes, level))
        farthest = _LONGEST * student(level, freedom)
        most = float(at(ordered, 0.5 + level / 2) + both) / 2
        least = float(at(ordered, 0.5 - level / 2) - both) / 2
        return max(least, -farthest), min(most, farthest)

    return bounds


def expanded(resampled: FloatArray, freedom: float, level: float) -> tuple[Any, Any]:
    """The percentile interval of a resampled statistic, taken where Student's t says.

    The plain percentile interval of few values is too short, as a normal interval is in place of
    Student's: its quantiles are taken at the tails of a normal variable beyond Student's reach.

    Args:
        resampled: [..., resamples] of the statistic.
        freedom: degrees: values less 1.
        level: coverage.
    Returns:
        [...] lower and [...] upper bounds.
    Source: Hesterberg 2015, "What teachers should know about the bootstrap", 3.4 (expanded
        percentile interval), without its factor of n / (n - 1), with which it covers too much.
    """
    ordered = np.sort(resampled, axis=-1)
    tail = normal_tail(student(level, freedom))
    return at(ordered, tail), at(ordered, 1 - tail)


def at(ordered: FloatArray, part: float) -> Any:
    """A quantile of sorted values.

    Args:
        ordered: [..., n], sorted.
        part: in [0, 1].
    Returns:
        [...].
    """
    n = ordered.shape[-1]
    place = part * (n - 1)
    under = int(place)
    above = min(under + 1, n - 1)
    first = ordered[..., under]
    return first + (place - under) * (ordered[..., above] - first)
