"""Claims about one checkpoint: a statistic over its episodes, with an interval."""

from collections.abc import Sequence
from math import ceil, log, sqrt
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.interval import (
    FEWEST_EPISODES,
    FEWEST_OF_TWO,
    LEVEL,
    FloatArray,
    Interval,
    Statistic,
    check_level,
    check_statistic,
    enough,
    figures,
    no_spread,
)
from gamekeeper.statistics.resampling import (
    at,
    expanded,
    interquartile_mean,
    resampled_iqm,
    t_of_means,
)
from gamekeeper.statistics.significance import wilson
from gamekeeper.statistics.student import binomial_at_most, student


def fewest_for_quantile(part: float, *, level: float = LEVEL) -> int:
    """Number of values that the interval of a quantile asks for.

    With fewer the chance that all values are on one side of the quantile is too large for any
    interval between them: 6 for the median, 72 for the 5 % quantile at a level of 0.95.

    Args:
        part: in (0, 1).
    Raises:
        EvidenceError: there is no such quantile, or no interval of this level.
    """
    check_level(level, "quantile")
    if not 0.0 < part < 1.0:
        raise EvidenceError(
            "there is no such quantile",
            where="quantile",
            expected="a part in (0, 1)",
            actual=str(part),
            fix="give a part between 0 and 1; 0.5 is the median",
        )
    return ceil(log((1 - level) / 2) / log(max(part, 1 - part)))


def quantile(
    values: Sequence[float] | FloatArray, part: float, *, level: float = LEVEL
) -> Interval:
    """A quantile with its interval, interpolated between order statistics.

    It needs no assumption on the distribution, but that values differ: where many are tied at the
    quantile, its bounds are values that were seen, and it covers more than it says.

    Args:
        values: [n].
        part: in (0, 1); 0.5 is the median.
        level: coverage, in [0.8, 0.99].
    Raises:
        EvidenceError: fewer than `fewest_for_quantile(part)` values, one isn't finite, or fewer
            than `LEAST_DISTINCT` of those between the bounds differ.
    Source: Nyblom 1992, "Note on interpolated order statistics", which for the median is
        Hettmansperger & Sheather 1986; the estimate interpolates as NumPy does.
    """
    ordered = np.sort(figures(values, "quantile"))
    enough(len(ordered), fewest_for_quantile(part, level=level), "values", where="quantile")
    tail = (1 - level) / 2
    distinct = float(differing(ordered, part, tail))
    if distinct < LEAST_DISTINCT:
        raise EvidenceError(
            "too many values around the quantile are equal",
            where="quantile",
            expected=f"at least {100 * LEAST_DISTINCT:g} % of these are distinct",
            actual=f"{100 * distinct:.0f} % are distinct",
            fix="show the figure without an interval",
        )
    value = float(np.quantile(ordered, part))
    low = _lower(ordered, part, tail)
    high = -_lower(-ordered[::-1], 1 - part, tail)
    return Interval(
        value, min(low, value), max(high, value), len(ordered), "between order statistics"
    )


LEAST_DISTINCT: Final = 0.6
"""Part of the values between a quantile's bounds that differ; found by simulation."""


def differing(ordered: FloatArray, part: float, tail: float) -> Any:
    """Part of the values between the bounds of a quantile that differ from one another.

    Args:
        ordered: [..., n], sorted.
        part: in (0, 1).
        tail: chance that the quantile is beyond either bound.
    Returns:
        [...].
    """
    n = ordered.shape[-1]
    # The upper bound is the lower one of the reversed values, at 1 - part.
    inner = ordered[..., ranks(n, part, tail)[0] - 1 : n + 1 - ranks(n, 1 - part, tail)[0]]
    return (1 + (np.diff(inner, axis=-1) > 0).sum(axis=-1)) / inner.shape[-1]


def ranks(n: int, part: float, tail: float) -> tuple[int, float]:
    """Ranks between which the bound lies that a quantile is under with the tail's chance.

    Returns:
        The number of an order statistic, from 1, and the weight of the next one.
    """
    under, above = 1, n
    while above - under > 1:
        half = (under + above) // 2
        if binomial_at_most(half - 1, n, part) <= tail:
            under = half
        else:
            above = half
    first, second = (binomial_at_most(under - 1, n, part), binomial_at_most(under, n, part))
    # Nyblom's weights: interpolated so that the chance beyond the bound is the tail's.
    off = under * (1 - part) * (second - tail)
    near = (n - under) * part * (tail - first)
    return under, near / (near + off) if near + off > 0 else 0.0


def _lower(ordered: FloatArray, part: float, tail: float) -> float:
    under, weight = ranks(len(ordered), part, tail)
    return float((1 - weight) * ordered[under - 1] + weight * ordered[under])


_UPRIGHT: Final = 0.2
"""Skewness / sqrt(n) up to which nothing is stretched: so much comes by chance."""
_STRETCH: Final = 2.5
"""Gain of the far side for each unit of skewness / sqrt(n) beyond that."""
_TAILED: Final = (0.8, 1.2)
"""Values' distance from being two (`_shape`), from which on, and at which wholly, a side is
stretched: a mass at zero, or a rare loss, is skewed and has no tail."""
_EQUAL: Final = (0.75, 0.5)
"""Part of the way from the symmetric to the equal-tailed interval: of values whose distance from
being two is `_FAR[0]` and less (2: normal ones), and of those with tails as far as `_FAR[1]`."""
_FAR: Final = (2.0, 4.0)
_LONGEST: Final = (1.4, 0.6)
"""A bound is at most so many times as far out as Student's, and so much more for a unit of
skewness / sqrt(n): resamples of a few rare values have next to no spread."""
_LEAST_VARIANCE: Final = 1e-12
"""Least variance of values whose variance should be about 1."""
_HEAPED: Final = (0.1, 0.25, 10.0)
"""Distance from being two, from where on a bound may be beyond the score interval of two values as
skewed; and how far for a unit of it, on the side that values lean from and on the other one."""

_PACKED: Final = 0.5
"""Values are packed against a floor where the lowest is nearer to the octile than so many times as
far as that is from the median; a lump at the floor, or a few far ones above others, aren't."""
_THINNING: Final = 3.0
"""Octiles that many times as far from the median on the one side as on the other, from where on
packed values thin out over orders of magnitude: 2.5 of exponential, 10 of log-normal ones of 2."""
_THINNED: Final = 150.0
"""Gain of the far side by a factor e of that ratio, over n."""
_SLANT: Final = (0.25, 0.35)
"""Skewness / sqrt(n) from which on, and at which wholly, it is gained."""


def reach_of_mean(t: FloatArray, values: FloatArray, level: float) -> tuple[FloatArray, FloatArray]:
    """Reach of the t of a mean either way, from its resamples and the values' shape.

    Between the equal-tailed and the symmetric interval; stretched on the side where values have a
    tail; and no farther than the score interval of two values that are as skewed, as far as the
    values are such: a few rare ones leave hardly any spread in resamples, or far too much. Farther
    again by `_far_tail` where values thin out over orders of magnitude.

    Args:
        t: [..., resamples] of Student's t.
        values: [..., n] that were resampled, with mean 0 and spread 1.
    Returns:
        [...] the least and the most that t is, in standard errors.
    Source: Efron & Tibshirani 1993, ch. 12.5 (bootstrap-t); Hall 1988, "On symmetric bootstrap
        confidence intervals"; Chen 1995, "Testing the mean of skewed distributions", for the side
        that falls short; Wilson 1927, written in the skewness of a share; chosen by simulation
        (benchmarks/evaluation_coverage.py, benchmarks/evaluation_truths.py).
    """
    ordered, both = np.sort(t, axis=-1), at(np.sort(np.abs(t), axis=-1), level)
    n = values.shape[-1]
    lean, heaped = _shape(values)
    bound = student(level, n - 1)
    tailed = np.clip((heaped - _TAILED[0]) / (_TAILED[1] - _TAILED[0]), 0.0, 1.0)
    under, above = stretches(lean, _STRETCH * tailed)
    low, high = _score_of_two(lean, n, bound)
    beyond = np.maximum(heaped - _HEAPED[0], 0.0)
    # The fewer values are heaped on two, the less the score interval of two values binds.
    low *= 1 + np.where(lean > 0, *_HEAPED[1:]) * beyond
    high *= 1 + np.where(lean < 0, *_HEAPED[1:]) * beyond
    farthest = bound * (_LONGEST[0] + _LONGEST[1] * np.abs(lean))
    equal = np.interp(heaped, _FAR, _EQUAL)
    least = under * (equal * at(ordered, 0.5 - level / 2) - (1 - equal) * both)
    most = above * (equal * at(ordered, 0.5 + level / 2) + (1 - equal) * both)
    gain = _far_tail(values, lean)
    return (
        np.maximum(least, -np.minimum(low, farthest)) * np.where(lean > 0, gain, 1.0),
        np.minimum(most, np.minimum(high, farthest)) * np.where(lean < 0, gain, 1.0),
    )


def _far_tail(values: FloatArray, lean: FloatArray) -> FloatArray:
    """Gain of the side of the tail where values thin out over orders of magnitude.

    The mean of such values, log-normal ones above all, hangs on some that most samples lack, and
    neither resamples nor the skewness that was seen know of them; but the octiles do.

    Args:
        values: [..., n].
        lean: [...] skewness / sqrt(n).
    Returns:
        [...] 1 or more.
    Source: Hinkley 1975, "On power transformations to symmetry", for telling skewness by quantiles
        on both sides of the median; constants by simulation (benchmarks/evaluation_coverage.py).
    """
    toward = np.where(np.asarray(lean)[..., None] < 0, -values, values)
    floor, octile, median, other = np.quantile(toward, (0.0, 0.125, 0.5, 0.875), axis=-1)
    near = median - octile
    is_packed = (floor < octile) & (octile - floor < _PACKED * near)
    ratio = np.where(is_packed, other - median, 0.0) / np.where(is_packed, near, 1.0)
    slant = np.clip((np.abs(lean) - _SLANT[0]) / (_SLANT[1] - _SLANT[0]), 0.0, 1.0)
    thinning = np.log(np.maximum(ratio / _THINNING, 1.0))
    return np.asarray(1 + _THINNED / values.shape[-1] * slant * thinning)


def _score_of_two(lean: FloatArray, n: int, bound: float) -> tuple[FloatArray, FloatArray]:
    """Reach of the score interval of a share, down and up in standard errors, by its skewness.

    A share p of n values has skewness / sqrt(n) = (1 - 2 p) / sqrt(n p (1 - p)), with which
    Wilson's bounds can be written without p.

    Args:
        lean: [...] skewness / sqrt(n).
        bound: standard errors of a normal variable.
    """
    square = bound * bound
    middle = square * lean / 2
    half = bound * np.sqrt(1 + square * (lean * lean + 4 / n) / 4)
    return (half + middle) / (1 + square / n), (half - middle) / (1 + square / n)


def stretches(lean: FloatArray, gain: Any) -> tuple[FloatArray, FloatArray]:
    """By how much the least and the most that t is are stretched.

    Args:
        lean: [...] skewness / sqrt(n). Where it is over 0, rare high values are missing from most
            samples, and the mean is under the truth: the least that t is falls short.
        gain: what the far side gains for each unit of it beyond what comes by chance, [...] or one.
    """
    return (
        1 + gain * np.maximum(lean - _UPRIGHT, 0.0),
        1 + gain * np.maximum(-lean - _UPRIGHT, 0.0),
    )


def _shape(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Skewness / sqrt(n), and how far values are from being two: kurtosis - skewness^2 - 1.

    This is 0 for two values, 0.8 for uniform and 2 for normal ones.

    Source: Pearson 1916 for kurtosis being skewness^2 + 1 at least.
    """
    off = values - values.mean(axis=-1, keepdims=True)
    square = off * off
    variance = np.maximum(square.mean(axis=-1), _LEAST_VARIANCE)
    skewness = (square * off).mean(axis=-1) / variance**1.5
    kurtosis = (square * square).mean(axis=-1) / variance**2
    return skewness / np.sqrt(values.shape[-1]), kurtosis - skewness**2 - 1


def one_sample(
    values: Sequence[float] | FloatArray,
    *,
    statistic: Statistic = "mean",
    rng: Generator,
    level: float = LEVEL,
    is_share: bool = False,
) -> Interval:
    """A statistic over the episodes of one checkpoint, with an interval.

    It is a claim about this checkpoint alone, over the seeds that might have been drawn.

    Args:
        values: [episodes] one figure of each.
        statistic: "mean", "iqm" or "median".
        level: coverage, in [0.8, 0.99].
        is_share: values are failure and success, 0 and 1.
    Raises:
        EvidenceError: fewer episodes than `FEWEST_EPISODES[statistic]` (of two outcomes
            `FEWEST_OF_TWO`), one isn't finite, or all are one number.
    Source: `around` says which interval it is, and whose.
    """
    array = figures(values, "one_sample")
    check_statistic(statistic, "one_sample")
    check_level(level, "one_sample")
    fewest = FEWEST_EPISODES[statistic]
    if statistic == "mean" and (is_share or len(np.unique(array)) <= 2):
        fewest = FEWEST_OF_TWO
    enough(len(array), fewest, "episodes", where="one_sample")
    return around(array, statistic=statistic, rng=rng, level=level, is_share=is_share)


def around(
    values: FloatArray,
    *,
    statistic: Statistic,
    rng: Generator,
    level: float,
    is_share: bool = False,
    unit: str = "episodes",
) -> Interval:
    """A statistic of independent values with its interval, however many there are.

    The mean of two outcomes gets Wilson's interval of their share; their IQM and median have none,
    as these are one of the two for most shares. Else the mean gets the bootstrap-t interval of
    `reach_of_mean`, the interquartile mean a t-expanded percentile interval, the median the
    interval between order statistics.

    Args:
        values: [n], two at least.
        is_share: values are failure and success, 0 and 1, or shares of success.
        unit: of the values, for the error.
    Raises:
        EvidenceError: all values are one number, and no shares.
    Source: Wilson 1927; `reach_of_mean`; Hesterberg 2015; Nyblom 1992; chosen by simulation
        (benchmarks/evaluation_coverage.py).
    """
    n, spread = len(values), float(values.std(ddof=1))
    mean, seen = float(values.mean()), np.unique(values)
    is_flat = spread <= 1e-12 * float(np.abs(values).max())
    if is_flat and not (is_share and mean in (0.0, 1.0)):
        raise no_spread(mean, n, unit, where=statistic)
    if is_flat or (len(seen) == 2 and statistic == "mean"):
        return _of_two(values, level)
    if len(seen) == 2:
        raise EvidenceError(
            "all values are one of two numbers, so that their mean tells all",
            where=statistic,
            expected="three different values or more",
            actual=f"{seen[0]:g} and {seen[1]:g}",
            fix="show the mean with its interval",
        )
    if statistic == "median":
        return quantile(values, 0.5, level=level)
    value = mean if statistic == "mean" else interquartile_mean(values)
    if statistic == "iqm":
        low, high = map(float, expanded(resampled_iqm(values, rng), n - 1, level))
        if high - low <= 1e-12 * float(np.abs(values).max()):
            raise EvidenceError(
                "nearly all of the middle half have one figure, so that nothing is known of its "
                "spread",
                where=statistic,
                expected="a middle half of figures that differ",
                actual=f"{value:g}",
                fix="show the figure without an interval",
            )
        return Interval(value, min(low, value), max(high, value), n, "t-expanded percentile")
    standard = (values - mean) / spread
    least, most = map(float, reach_of_mean(t_of_means(standard, rng), standard, level))
    error = spread / sqrt(n)
    # t is (mean - truth) / error, so its greatest value bounds the truth from below.
    return Interval(value, value - most * error, value - least * error, n, "bootstrap-t")


def _of_two(values: FloatArray, level: float) -> Interval:
    """The interval of a share, carried over to the mean of two outcomes."""
    least, most = (0.0, 1.0) if values.min() == values.max() else (values.min(), values.max())
    share = wilson(int((values == most).sum()), len(values), level=level)
    value, low, high = (float(least + (most - least) * p) for p in (share.p, share.low, share.high))
    return Interval(value, low, high, len(values), "Wilson, of two outcomes")
