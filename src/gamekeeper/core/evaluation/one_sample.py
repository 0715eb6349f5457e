"""Claims about one checkpoint: a statistic over its episodes, with an interval."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

import numpy as np
from numpy.random import Generator

from gamekeeper.core.evaluation.bootstrap import expanded, t_of_means
from gamekeeper.core.evaluation.interval import (
    LEVEL,
    FloatArray,
    Interval,
    Statistic,
    check_level,
    check_statistic,
    figures,
)
from gamekeeper.core.evaluation.iqm import interquartile_mean, resampled_iqm
from gamekeeper.core.evaluation.order_statistics import quantile
from gamekeeper.core.evaluation.refusals import FEWEST_EPISODES, enough
from gamekeeper.core.evaluation.skewed import reach_of_mean
from gamekeeper.core.stats import wilson


def one_sample(
    values: Sequence[float] | FloatArray,
    *,
    statistic: Statistic = "mean",
    rng: Generator,
    level: float = LEVEL,
) -> Interval:
    """A statistic over the episodes of one checkpoint, with an interval.

    It is a claim about this checkpoint alone, over the seeds that might have been drawn.

    Args:
        values: [episodes] one figure of each.
        statistic: "mean", "iqm" or "median".
        rng: draws the resamples.
        level: coverage, in [0.8, 0.99].
    Raises:
        EvidenceError: fewer episodes than `FEWEST_EPISODES[statistic]`, or one isn't finite.
    Source: `around` says which interval it is, and whose.
    """
    array = figures(values, "one_sample")
    check_statistic(statistic, "one_sample")
    check_level(level, "one_sample")
    enough(len(array), FEWEST_EPISODES[statistic], "episodes", where="one_sample")
    return around(array, statistic=statistic, rng=rng, level=level)


def around(values: FloatArray, *, statistic: Statistic, rng: Generator, level: float) -> Interval:
    """A statistic of independent values with its interval, however many there are.

    Two outcomes get Wilson's interval of their share. Else the mean gets a bootstrap-t interval
    (half way between the equal-tailed and the symmetric one, farther on the side where values lean
    from), the interquartile mean a t-expanded
    percentile interval, the median the interval between order statistics. Where all values are one
    number, nothing is known of their spread, and the interval is that number.

    Args:
        values: [n], two at least.
        statistic: which.
        rng: draws the resamples.
        level: coverage.
    Source: Wilson 1927; `reach_of_mean`; Hesterberg 2015; Nyblom 1992; chosen by simulation
        (benchmarks/evaluation_coverage.py).
    """
    if statistic == "median":
        return quantile(values, 0.5, level=level)
    seen = np.unique(values)
    if len(seen) == 2 or (len(seen) == 1 and seen[0] in (0.0, 1.0)):
        return _of_two(values, statistic, level)
    mean = float(values.mean())
    value = mean if statistic == "mean" else interquartile_mean(values)
    n, spread = len(values), float(values.std(ddof=1))
    if spread <= 1e-12 * float(np.abs(values).max()):
        return Interval(value, value, value, n, "all values are one number")
    if statistic == "iqm":
        low, high = map(float, expanded(resampled_iqm(values, rng), n - 1, level))
        return Interval(value, min(low, value), max(high, value), n, "t-expanded percentile")
    standard = (values - mean) / spread
    least, most = map(float, reach_of_mean(t_of_means(standard, rng), standard, level))
    error = spread / sqrt(n)
    return Interval(value, value - most * error, value - least * error, n, "bootstrap-t")


def _of_two(values: FloatArray, statistic: Statistic, level: float) -> Interval:
    """The interval of a share, carried over to the statistic, which rises with it."""
    least, most = (0.0, 1.0) if values.min() == values.max() else (values.min(), values.max())
    n, cut = len(values), len(values) // 4
    share = wilson(int((values == most).sum()), n, level=level)

    def carried(p: float) -> float:
        kept = min(max((p * n - cut) / (n - 2 * cut), 0.0), 1.0) if statistic == "iqm" else p
        return float(least + (most - least) * kept)

    return Interval(
        carried(share.p), carried(share.low), carried(share.high), n, "Wilson, of two outcomes"
    )
