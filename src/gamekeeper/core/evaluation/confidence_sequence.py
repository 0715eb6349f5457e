"""Intervals that hold at every n at once, so that one may stop when they are narrow enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.core.evaluation.interval import (
    LEVEL,
    FloatArray,
    Interval,
    check_level,
    figures,
)
from gamekeeper.core.evaluation.refusals import enough
from gamekeeper.errors import EvidenceError

_GRID: Final = 1_000
"""Steps in which the mean is looked for; a bound is at most one of them too far out."""
_COLUMNS: Final = 64
"""Means that are looked at together, to bound memory."""
_STAKE: Final = 0.5
"""The largest part of the capital that is put at risk in one bet."""
_WARM_UP: Final = 100
"""Unbounded values before which nothing is claimed, found by simulation with the stopping
(benchmarks/evaluation_coverage.py)."""
_TIGHTEST_AT: Final = 500
"""Unbounded values at which the interval is made to be as narrow as it can be."""


@dataclass(frozen=True, slots=True)
class ConfidenceSequence:
    """An interval of a mean for every number of values, all holding at once with chance `level`.

    An interval made for one n is wrong once n depends on what was seen: who plays until it is
    narrow stops where luck made it so. These hold however one stops, and so are wider. Bounded
    values: exact, by betting against each mean. Unbounded values: as n grows, from `warm_up` on.

    Attributes:
        least: the least a value can be (0 for success); None: values aren't bounded.
        most: the most a value can be (1 for success); None with `least`.
        level: chance that all intervals hold, in [0.8, 0.9999]: to watch several sequences at once,
            divide 1 - level by their number.

    Raises:
        EvidenceError: one bound without the other, most not over least, or a level out of range.
    Source: Waudby-Smith & Ramdas 2023, "Estimating means of bounded random variables by betting",
        theorem 3; Waudby-Smith, Arbour, Sinha, Kennedy & Ramdas 2021, "Time-uniform central limit
        theory and asymptotic confidence sequences", theorem 2.2.
    """

    least: float | None = None
    most: float | None = None
    level: float = LEVEL

    def __post_init__(self) -> None:
        """Bounds come together and in order."""
        check_level(self.level, "ConfidenceSequence", most=0.9999)
        check_bounds(self.least, self.most, "ConfidenceSequence")

    @property
    def warm_up(self) -> int:
        """Values before which nothing is claimed: the interval is everything there is."""
        return 1 if self.least is not None else _WARM_UP

    def sequence(self, values: Sequence[float] | FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds after each value.

        Args:
            values: [n] in the order in which they were played.
        Returns:
            [n] lower and [n] upper bounds of the mean; infinite before the warm-up.
        Raises:
            EvidenceError: a value isn't finite, or outside of the bounds.
        """
        array = figures(values, "ConfidenceSequence")
        if self.least is None or self.most is None:
            return _asymptotic(array, 1 - self.level)
        inside(array, self.least, self.most, "ConfidenceSequence")
        wide = self.most - self.least
        shares = (array - self.least) / wide
        low, high = _betting(shares, 1 - self.level)
        return self.least + wide * low, self.least + wide * high

    def stop_at(self, values: Sequence[float] | FloatArray, width: float) -> int | None:
        """How many values suffice for an interval at most so wide; None: not these.

        Args:
            values: [n] in the order in which they were played.
            width: high - low, in the values' units, over 0.
        Raises:
            EvidenceError: as `sequence`, or the width isn't over 0.
        """
        return first_narrow(self.sequence(values), width, "ConfidenceSequence.stop_at")

    def interval(self, values: Sequence[float] | FloatArray) -> Interval:
        """The mean of all values with the interval after the last, valid however one stopped.

        Args:
            values: [n] in the order in which they were played.
        Raises:
            EvidenceError: as `sequence`, or there are fewer than `warm_up`.
        """
        array = figures(values, "ConfidenceSequence")
        enough(len(array), self.warm_up, "values", where="ConfidenceSequence")
        low, high = self.sequence(array)
        how = "asymptotic" if self.least is None else "by betting"
        return Interval(
            float(array.mean()),
            float(low[-1]),
            float(high[-1]),
            len(array),
            f"confidence sequence, {how}",
        )


def check_bounds(least: float | None, most: float | None, where: str) -> None:
    """Bounds come together and in order.

    Args:
        least: the least a value can be.
        most: the most.
        where: what asks, for the error.
    Raises:
        EvidenceError: one without the other, or most not over least.
    """
    if least is None and most is None:
        return
    if least is None or most is None or not least < most:
        raise EvidenceError(
            "values have no such bounds",
            where=where,
            expected="least < most, or neither",
            seen=f"least={least}, most={most}",
        )


def inside(array: FloatArray, least: float, most: float, where: str) -> None:
    """Values are within their bounds.

    Args:
        array: [n].
        least: the least a value can be.
        most: the most.
        where: what asks, for the error.
    Raises:
        EvidenceError: one isn't.
    """
    if len(array) and not least <= array.min() <= array.max() <= most:
        raise EvidenceError(
            "a value is outside of its bounds",
            where=where,
            expected=f"[{least}, {most}]",
            seen=f"{array.min()} to {array.max()}",
            mend="give the bounds that hold, or none",
        )


def first_narrow(bounds: tuple[FloatArray, FloatArray], width: float, where: str) -> int | None:
    """After how many values the bounds are at most so far apart; None: after none of these.

    Args:
        bounds: [n] each, after each value.
        width: high - low.
        where: what asks, for the error.
    Raises:
        EvidenceError: it isn't over 0.
    """
    if not width > 0:
        raise EvidenceError(
            "no interval is so narrow", where=where, expected="a width over 0", seen=str(width)
        )
    low, high = bounds
    narrow = np.flatnonzero(high - low <= width)
    return int(narrow[0]) + 1 if len(narrow) else None


def _asymptotic(values: FloatArray, error: float) -> tuple[FloatArray, FloatArray]:
    """The bounds of unbounded values, whose variance is estimated from each prefix."""
    n = np.arange(1, len(values) + 1, dtype=np.float64)
    centre = values[:_WARM_UP].mean() if len(values) else 0.0  # far from 0, squares cancel
    off = values - centre
    mean = np.cumsum(off) / n
    spread = np.sqrt(np.maximum(np.cumsum(off * off) / n - mean * mean, 0.0))
    aim = -2 * log(error)
    ratio = n * (aim + log(aim) + 1) / _TIGHTEST_AT
    reach = spread * np.sqrt((ratio + 1) / (n * ratio) * np.log((ratio + 1) / error**2))
    reach[: _WARM_UP - 1] = np.inf
    return centre + mean - reach, centre + mean + reach


def _betting(shares: FloatArray, error: float) -> tuple[FloatArray, FloatArray]:
    """The means in [0, 1] against which betting, either way, hasn't won 1 / error yet."""
    n = np.arange(1, len(shares) + 1, dtype=np.float64)
    mean = (0.5 + np.cumsum(shares)) / (n + 1)
    variance = (0.25 + np.cumsum((shares - mean) ** 2)) / (n + 1)
    before = np.concatenate([[0.25], variance[:-1]])
    stake = np.sqrt(2 * log(2 / error) / (before * n * np.log(n + 1)))
    low, high = np.ones(len(shares)), np.zeros(len(shares))
    for start in range(0, _GRID + 1, _COLUMNS):
        truths = np.arange(start, min(start + _COLUMNS, _GRID + 1)) / _GRID
        held = _unbeaten(shares, truths, stake, log(2 / error))
        low = np.minimum(low, np.where(held, truths, 1.0).min(axis=1))
        high = np.maximum(high, np.where(held, truths, 0.0).max(axis=1))
    plain = np.cumsum(shares) / n
    low = np.minimum(np.maximum(low - 1 / _GRID, 0.0), plain)
    high = np.maximum(np.minimum(high + 1 / _GRID, 1.0), plain)
    return low, high


def _unbeaten(
    shares: FloatArray, truths: FloatArray, stake: FloatArray, most: float
) -> NDArray[np.bool_]:
    """Whether neither bettor has more than exp(most), after each value and for each truth."""
    off = shares[:, None] - truths
    with np.errstate(divide="ignore"):
        up = np.minimum(stake[:, None], _STAKE / truths)
        down = np.minimum(stake[:, None], _STAKE / (1 - truths))
    above = np.cumsum(np.log1p(up * off), axis=0)
    below = np.cumsum(np.log1p(-down * off), axis=0)
    return np.asarray(np.maximum(above, below) < most)
