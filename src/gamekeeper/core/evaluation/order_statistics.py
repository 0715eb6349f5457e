"""Quantiles with intervals between order statistics, which hold for every distribution."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, log

import numpy as np

from gamekeeper.core.evaluation.interval import (
    LEVEL,
    FloatArray,
    Interval,
    check_level,
    figures,
)
from gamekeeper.core.evaluation.refusals import enough
from gamekeeper.core.evaluation.student import binomial_at_most
from gamekeeper.errors import EvidenceError


def fewest_for_quantile(part: float, *, level: float = LEVEL) -> int:
    """How many values the interval of a quantile asks for.

    With fewer the chance that all values are on one side of the quantile is too large for any
    interval between them: 6 for the median, 72 for the 5 % quantile at a level of 0.95.

    Args:
        part: in (0, 1).
        level: coverage.
    Raises:
        EvidenceError: there is no such quantile, or no interval of this level.
    """
    check_level(level, "quantile")
    if not 0.0 < part < 1.0:
        raise EvidenceError(
            "there is no such quantile",
            where="quantile",
            expected="a part in (0, 1)",
            seen=str(part),
        )
    return ceil(log((1 - level) / 2) / log(max(part, 1 - part)))


def quantile(
    values: Sequence[float] | FloatArray, part: float, *, level: float = LEVEL
) -> Interval:
    """A quantile with its interval, interpolated between order statistics.

    It needs no assumption on the distribution. Where values are tied it covers more than it says,
    because its bounds are values that were seen.

    Args:
        values: [n].
        part: in (0, 1); 0.5 is the median.
        level: coverage, in [0.8, 0.99].
    Raises:
        EvidenceError: fewer than `fewest_for_quantile(part)` values, or one isn't finite.
    Source: Nyblom 1992, "Note on interpolated order statistics", which for the median is
        Hettmansperger & Sheather 1986; the estimate interpolates as NumPy does.
    """
    ordered = np.sort(figures(values, "quantile"))
    enough(len(ordered), fewest_for_quantile(part, level=level), "values", where="quantile")
    tail = (1 - level) / 2
    value = float(np.quantile(ordered, part))
    low = _lower(ordered, part, tail)
    high = -_lower(-ordered[::-1], 1 - part, tail)
    return Interval(
        value, min(low, value), max(high, value), len(ordered), "between order statistics"
    )


def ranks(n: int, part: float, tail: float) -> tuple[int, float]:
    """Where the bound lies which a quantile is under with the chance of the tail.

    Args:
        n: values.
        part: of the quantile.
        tail: chance.
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
    off = under * (1 - part) * (second - tail)
    near = (n - under) * part * (tail - first)
    return under, near / (near + off) if near + off > 0 else 0.0


def _lower(ordered: FloatArray, part: float, tail: float) -> float:
    under, weight = ranks(len(ordered), part, tail)
    return float((1 - weight) * ordered[under - 1] + weight * ordered[under])
