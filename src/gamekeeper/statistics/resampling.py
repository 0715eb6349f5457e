"""Resampling: bootstrap-t half way between its two kinds, and the t-expanded percentile interval.

Which is used where, and from how few values on, was found by simulation
(benchmarks/evaluation_coverage.py, benchmarks/interval_coverage.py).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from gamekeeper.statistics.interval import FloatArray, enough, figures
from gamekeeper.statistics.student import normal_tail, student

Reach = Callable[[float], tuple[float, float]]
"""By level: the least and the most that t is, in standard errors."""

RESAMPLES: Final = 4_999
"""Bootstrap resamples."""
TRUSTED: Final = 0.99
"""The highest level whose bounds are quantiles of resamples: 25 of them lie beyond either one."""
CHUNK: Final = 2**21
"""Numbers that are drawn at once, to bound memory."""
_LONGEST: Final = 1.45
"""A bound is at most so many times as far out as Student's. Resamples of a few rare values have
next to no spread, and a quantile of their t is then any number; found by simulation, like the
halves below."""
_LEAST_VARIANCE: Final = 1e-12
"""Least variance of a resample, where the sample's is about 1: t stays a number."""


def t_of_means(values: FloatArray, rng: Generator) -> FloatArray:
    """Student's t of the means of resamples of values [n] with mean 0 and spread 1.

    Returns:
        [resamples], not sorted.
    """
    n = len(values)
    t = np.empty(RESAMPLES)
    step = max(CHUNK // n, 1)
    for start in range(0, RESAMPLES, step):
        drawn = values[rng.integers(0, n, (min(step, RESAMPLES - start), n))]
        mean = drawn.mean(axis=1)
        # The variance is that with divisor n; sqrt(n - 1) below makes its root the usual error.
        variance = np.einsum("ij,ij->i", drawn, drawn) / n - mean * mean
        t[start : start + step] = (
            mean * sqrt(n - 1) / np.sqrt(np.maximum(variance, _LEAST_VARIANCE))
        )
    return t


def reach(t: FloatArray, freedom: float) -> Reach:
    """Reach of t either way, half way between the equal-tailed and the symmetric interval.

    The equal-tailed one follows a skew, the symmetric one bears few distinct values.

    Args:
        t: [resamples] of Student's t.
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

    return extended(bounds, freedom)


def extended(bounds: Reach, freedom: float) -> Reach:
    """The reach at levels that resamples can't tell: Student's, on the scale of the last they can.

    So a p-value has no floor, and many tests may be corrected for their number.

    Args:
        bounds: up to the level `TRUSTED`.
        freedom: degrees of Student's t.
    """

    def beyond(level: float) -> tuple[float, float]:
        if level <= TRUSTED:
            return bounds(level)
        scale = student(level, freedom) / student(TRUSTED, freedom)
        least, most = bounds(TRUSTED)
        return scale * least, scale * most

    return beyond


def expanded(resampled: FloatArray, freedom: float, level: float) -> tuple[Any, Any]:
    """The percentile interval of a resampled statistic, taken where Student's t says.

    The plain percentile interval of few values is too short, as a normal interval is in place of
    Student's: its quantiles are taken at the tails of a normal variable beyond Student's reach.

    Args:
        resampled: [..., resamples] of the statistic.
        freedom: degrees: values less 1.
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


def interquartile_mean(values: Sequence[float] | FloatArray) -> float:
    """The mean of what is left without the lowest and highest quarter.

    A quarter is `n // 4` values, so that for any n it is what rliable and SciPy's `trim_mean`
    give.

    Args:
        values: [n], one at least.
    Raises:
        EvidenceError: there are none, or one isn't finite.
    Source: Agarwal et al. 2021, "Deep reinforcement learning at the edge of the statistical
        precipice".
    """
    ordered = figures(values, "interquartile_mean")
    enough(len(ordered), 1, "values", where="interquartile_mean")
    return float(middle(ordered).mean())


def middle(samples: FloatArray) -> FloatArray:
    """Values of each sample [..., n] without its lowest and highest quarter, in no order.

    Returns:
        [..., n - 2 * (n // 4)].
    """
    n = samples.shape[-1]
    cut = n // 4
    if cut == 0:
        return samples
    return np.partition(samples, (cut, n - cut - 1), axis=-1)[..., cut : n - cut]


def resampled_iqm(values: FloatArray, rng: Generator) -> FloatArray:
    """The interquartile mean of each of many resamples of values [n].

    Returns:
        [resamples].
    """
    n = len(values)
    found = np.empty(RESAMPLES)
    step = max(CHUNK // n, 1)
    for start in range(0, RESAMPLES, step):
        drawn = values[rng.integers(0, n, (min(step, RESAMPLES - start), n))]
        found[start : start + step] = middle(drawn).mean(axis=1)
    return found


Estimate = Callable[[Sequence[FloatArray]], tuple[FloatArray, FloatArray]]
"""[..., runs] of each stratum -> the estimate [...], and its variance by stratum [..., strata]."""


@dataclass(frozen=True, slots=True)
class Stratified:
    """An estimate over strata and how far its t goes.

    Attributes:
        error: its standard error.
        bounds: how far t goes either way, by level; None where nothing varied.
        freedom: degrees of Student's t; 0 where nothing varied.
    """

    value: float
    error: float
    bounds: Reach | None
    freedom: float = 0.0


def weighted_means(weights: Sequence[float]) -> Estimate:
    """The weighted sum of strata's means.

    Args:
        weights: one for each stratum; -1 and 1 make a difference.
    """

    def estimate(strata: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        pairs = list(zip(weights, strata, strict=True))
        value = sum(weight * each.mean(axis=-1) for weight, each in pairs)
        variances = [w * w * each.var(axis=-1, ddof=1) / each.shape[-1] for w, each in pairs]
        return np.asarray(value), np.stack(variances, axis=-1)

    return estimate


def pooled_iqm(strata: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """The interquartile mean of all strata's values at once, and its variance by stratum.

    The variance is that of the values drawn in to the quartiles (winsorised), within strata.

    Args:
        strata: [..., runs] of each, equally many runs.
    Source: Tukey & McLaughlin 1963, for the variance of a trimmed mean.
    """
    kept = middle(np.concatenate(strata, axis=-1))
    low, high = kept.min(axis=-1)[..., None], kept.max(axis=-1)[..., None]
    drawn_in = [np.clip(each, low, high).var(axis=-1, ddof=1) * each.shape[-1] for each in strata]
    return kept.mean(axis=-1), np.stack(drawn_in, axis=-1) / kept.shape[-1] ** 2


def stratified(strata: Sequence[FloatArray], estimate: Estimate, rng: Generator) -> Stratified:
    """An estimate with the bootstrap distribution of its t, resampled within strata.

    Args:
        strata: [runs] of each, two at least.
        estimate: of all.
    Source: Davison & Hinkley 1997, 3.2 (several samples); Satterthwaite 1946 for the degrees of
        freedom of the bound on t.
    """
    value, variances = estimate(strata)
    variance = float(variances.sum())
    largest = max(float(np.abs(each).max()) for each in strata)
    # What is left by rounding of equal scores is no spread.
    if variance <= (1e-12 * largest) ** 2:
        return Stratified(float(value), 0.0, None)
    t = np.empty(RESAMPLES)
    step = max(CHUNK // sum(map(len, strata)), 1)
    for start in range(0, RESAMPLES, step):
        many = min(step, RESAMPLES - start)
        drawn = [each[rng.integers(0, len(each), (many, len(each)))] for each in strata]
        values, spreads = estimate(drawn)
        errors = np.sqrt(np.maximum(spreads.sum(axis=-1), 1e-12 * variance))
        t[start : start + many] = (values - value) / errors
    degrees = np.array([len(each) - 1 for each in strata])
    # Satterthwaite: variances of strata add up, each known with one degree less than its runs.
    freedom = variance**2 / float((variances**2 / degrees).sum())
    return Stratified(float(value), variance**0.5, reach(t, freedom), freedom)
