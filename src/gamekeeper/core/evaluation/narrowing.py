"""Intervals for playing until they are narrow enough, which cover as they say with the stopping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

import numpy as np

from gamekeeper.core.evaluation.confidence_sequence import check_bounds, first_narrow, inside
from gamekeeper.core.evaluation.interval import (
    LEVEL,
    FloatArray,
    Interval,
    check_level,
    figures,
)
from gamekeeper.core.evaluation.refusals import enough
from gamekeeper.core.evaluation.skewed import stretches
from gamekeeper.core.evaluation.student import series

_WARM_UP: Final = {True: 50, False: 150}
"""Values before which nothing is claimed, bounded and not: who stops earlier stops where luck made
the interval narrow. Found by simulation with the stopping (benchmarks/evaluation_coverage.py)."""
_STRETCH: Final = 2.0
"""What the far side gains for each unit of skewness / sqrt(n) beyond what comes by chance; found
likewise."""
_CENTRE: Final = 50
"""Values from whose mean the others are counted."""
_FLAT: Final = 1e-9
"""Skewness / sqrt(n) below which Hall's interval is Student's."""
_SPECK: Final = 1e-24
"""Of the largest square, under which a variance is none."""


@dataclass(frozen=True, slots=True)
class Narrowing:
    """Intervals of a mean after each value, to stop at the first that is narrow enough.

    They hold as often as they say where playing stops at a width and was looked at not before
    `warm_up`; who stops for other reasons wants a `ConfidenceSequence`, which holds however one
    stops and asks for twice as many values and more. Two outcomes: Wilson's. Others: on each side
    the farther of Student's bound and Hall's, which follows the skewness.

    Attributes:
        least: the least a value can be (0 for success); None: values aren't bounded.
        most: the most a value can be (1 for success); None with `least`.
        level: coverage, in [0.8, 0.99].

    Raises:
        EvidenceError: one bound without the other, most not over least, or a level out of range.
    Source: Chow & Robbins 1965, "On the asymptotic theory of fixed-width sequential confidence
        intervals for the mean"; Frey 2010, "Fixed-width sequential confidence intervals for a
        proportion"; Hall 1992, "On the removal of skewness by transformation".
    """

    least: float | None = None
    most: float | None = None
    level: float = LEVEL

    def __post_init__(self) -> None:
        """Bounds come together and in order."""
        check_level(self.level, "Narrowing")
        check_bounds(self.least, self.most, "Narrowing")

    @property
    def warm_up(self) -> int:
        """Values before which nothing is claimed: the interval is everything there is."""
        return _WARM_UP[self.least is not None]

    def sequence(self, values: Sequence[float] | FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds after each value.

        Args:
            values: [n] in the order in which they were played.
        Returns:
            [n] lower and [n] upper bounds of the mean; infinite before the warm-up.
        Raises:
            EvidenceError: a value isn't finite, or outside of the bounds.
        """
        array = figures(values, "Narrowing")
        if self.least is not None and self.most is not None:
            inside(array, self.least, self.most, "Narrowing")
        low, high = _of_any(array, self.level)
        if self.least is not None and self.most is not None:
            low, high = np.maximum(low, self.least), np.minimum(high, self.most)
        two = self._of_two(array)
        if two:
            low[two.since : two.until], high[two.since : two.until] = two.bounds(array, self.level)
        low[: self.warm_up - 1], high[: self.warm_up - 1] = -np.inf, np.inf
        return low, high

    def stop_at(self, values: Sequence[float] | FloatArray, width: float) -> int | None:
        """How many values suffice for an interval at most so wide; None: not these.

        Args:
            values: [n] in the order in which they were played.
            width: high - low, in the values' units, over 0.
        Raises:
            EvidenceError: as `sequence`, or the width isn't over 0.
        """
        return first_narrow(self.sequence(values), width, "Narrowing.stop_at")

    def interval(self, values: Sequence[float] | FloatArray) -> Interval:
        """The mean of all values with the interval after the last.

        Args:
            values: [n] in the order in which they were played.
        Raises:
            EvidenceError: as `sequence`, or there are fewer than `warm_up`.
        """
        array = figures(values, "Narrowing")
        enough(len(array), self.warm_up, "values", where="Narrowing")
        low, high = self.sequence(array)
        two = self._of_two(array)
        how = "Wilson" if two and two.until == len(array) else "the farther of Student's and Hall's"
        return Interval(
            float(array.mean()), float(low[-1]), float(high[-1]), len(array), f"{how}, narrowing"
        )

    def _of_two(self, array: FloatArray) -> _Two | None:
        """The two outcomes that there are at first: the bounds, or the first two that are seen."""
        ends = [each for each in (self.least, self.most) if each is not None]
        if len(array) and array[0] in ends:
            since, pair = 0, ends
        else:
            others = np.flatnonzero(array != array[0]) if len(array) else np.empty(0, np.intp)
            if not len(others):
                return None
            since, pair = int(others[0]), [float(array[0]), float(array[others[0]])]
        more = np.flatnonzero(~np.isin(array, pair))
        return _Two(min(pair), max(pair), since, int(more[0]) if len(more) else len(array))


@dataclass(frozen=True, slots=True)
class _Two:
    """Two outcomes, and between which values there were just these."""

    least: float
    most: float
    since: int
    until: int

    def bounds(self, array: FloatArray, level: float) -> tuple[FloatArray, FloatArray]:
        """Wilson's bounds after each value from `since` to `until`."""
        n = np.arange(1, self.until + 1, dtype=np.float64)[self.since :]
        p = np.cumsum(array[: self.until] == self.most)[self.since :] / n
        z = NormalDist().inv_cdf(0.5 + level / 2)
        centre = (p + z * z / (2 * n)) / (1 + z * z / n)
        reach = z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
        low, high = np.clip(centre - reach, 0.0, p), np.clip(centre + reach, p, 1.0)
        wide = self.most - self.least
        return self.least + wide * low, self.least + wide * high


def _of_any(values: FloatArray, level: float) -> tuple[FloatArray, FloatArray]:
    """The farther of Student's bound and Hall's, from the moments of each prefix."""
    n = np.arange(1, len(values) + 1, dtype=np.float64)
    centre = values[:_CENTRE].mean() if len(values) else 0.0  # far from 0, powers cancel
    off = values - centre
    one, two, three = (np.cumsum(off**power) / n for power in (1, 2, 3))
    variance = np.maximum(two - one**2, 0.0)
    error = np.sqrt(variance / np.maximum(n - 1, 1))
    third = three - 3 * one * two + 2 * one**3
    spread = np.maximum(variance, _SPECK * float(np.abs(values).max(initial=1.0)) ** 2)
    lean = third / spread**1.5 / np.sqrt(n)
    far = series(NormalDist().inv_cdf(0.5 + level / 2), np.maximum(n - 1, 1))  # told from 50 on
    under, above = stretches(lean, _STRETCH)
    least = -under * np.maximum(far, -_hall(-far, lean))
    most = above * np.maximum(far, _hall(far, lean))
    return centre + one - most * error, centre + one - least * error


def _hall(t: FloatArray, lean: FloatArray) -> FloatArray:
    """The t at which Hall's transformed one is as given."""
    a = np.where(np.abs(lean) < _FLAT, _FLAT, lean)
    return np.asarray(3 / a * (np.cbrt(1 + a * (t - a / 6)) - 1))
