"""Effects over paired episodes: a mean difference with an interval that covers at its level."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb, copysign, inf, sqrt
from statistics import NormalDist
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.resampling import RESAMPLES, Reach, reach, t_of_means
from gamekeeper.statistics.student import env_step

FloatArray = NDArray[np.float64]

FEWEST: Final = 50
"""Pairs below which no interval is claimed: its coverage isn't what it says."""


@dataclass(frozen=True, slots=True)
class PairedEffect:
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
        return {"value": self.value, "low": self.low, "high": self.high, "p": self.p, "n": self.n}


def paired_effect(
    base: FloatArray, changed: FloatArray, *, rng: Generator, level: float = 0.95
) -> PairedEffect:
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
        low, high = tango(more, less, n, level)
        return PairedEffect(value, low, high, _mcnemar(more, less), n)
    spread = float(differences.std(ddof=1))
    if spread <= 1e-12 * float(np.abs(differences).max()):
        return PairedEffect(value, value, value, 1.0 if value == 0 else 2.0 ** (1 - n), n)
    error = spread / sqrt(n)
    bounds = reach(t_of_means((differences - value) / spread, rng), n - 1)
    least, most = bounds(level)
    return PairedEffect(
        value, value - most * error, value - least * error, least_p(bounds, value / error), n
    )


def _differences(base: FloatArray, changed: FloatArray, level: float) -> FloatArray:
    one, two = np.asarray(base, np.float64), np.asarray(changed, np.float64)
    if one.ndim != 1 or one.shape != two.shape:
        raise EvidenceError(
            "two arms can't be paired",
            where="paired_effect",
            expected="[episodes] twice, equally many",
            actual=f"{one.shape} and {two.shape}",
            fix="pair figures of the same seeds in the same order",
        )
    if len(one) < FEWEST:
        raise EvidenceError(
            "too few pairs for an interval of this level",
            where="paired_effect",
            expected=f"at least {FEWEST} pairs",
            actual=str(len(one)),
            fix="play more episodes",
        )
    if not 0.8 <= level <= 0.999:
        raise EvidenceError(
            "no interval of this level",
            where="paired_effect",
            expected="level in [0.8, 0.999]",
            actual=str(level),
            fix="choose a level of this range; 0.95 is usual",
        )
    differences = two - one
    if not np.isfinite(differences).all():
        raise EvidenceError(
            "a figure isn't finite",
            where="paired_effect",
            expected="finite numbers",
            actual=f"pair {int(np.flatnonzero(~np.isfinite(differences))[0])}",
            fix="leave out pairs without a finite figure, and say so",
        )
    return differences


def tango(more: int, less: int, n: int, level: float) -> tuple[float, float]:
    """The differences of proportions that a score test doesn't reject.

    Args:
        more: pairs that differ by 1.
        less: pairs that differ by -1.
        n: all pairs.
        level: coverage.
    Source: Tango 1998.
    """
    z = NormalDist().inv_cdf(0.5 + level / 2)
    value = (more - less) / n

    def score(truth: float) -> float:
        a, b = 2 * n, (2 * n - more + less) * truth - more - less
        less_share = (sqrt(max(b * b + 4 * a * less * truth * (1 - truth), 0.0)) - b) / (2 * a)
        variance = n * (2 * less_share + truth * (1 - truth))
        off = more - less - n * truth
        return off / sqrt(variance) if variance > 0 else copysign(inf, off)

    low = -1.0 if value == -1 else env_step(lambda truth: score(truth) > z, -1.0, value)
    high = 1.0 if value == 1 else env_step(lambda truth: score(truth) > -z, value, 1.0)
    return low, high


def _mcnemar(more: int, less: int) -> float:
    """The exact p-value of both ways to differ being equally likely."""
    pairs = more + less
    tail = sum(comb(pairs, k) for k in range(min(more, less) + 1))
    return float(min(2 * tail / 2**pairs, 1.0))


def least_p(bounds: Reach, t: float) -> float:
    """One minus the highest level whose interval leaves 0 out; 2 / 5,000 at least.

    Args:
        bounds: how far the estimate is off either way, by level.
        t: the estimate, in the same unit.
    """

    def leaves_out(level: float) -> bool:
        least, most = bounds(level)
        return not least <= t <= most

    return max(1 - env_step(leaves_out, 0.0, 1.0 - 1e-9), 2 / (RESAMPLES + 1))
