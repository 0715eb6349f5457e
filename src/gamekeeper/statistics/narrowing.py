"""Intervals of a mean after each value, to stop once they are narrow enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final

import numpy as np

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.interval import LEVEL, FloatArray, Interval, check_level, enough, figures
from gamekeeper.statistics.one_sample import stretches
from gamekeeper.statistics.student import series

_MOST_LEVEL: Final = 0.99
_WARM_UP: Final = {True: 50, False: 150}
"""Values before which nothing is claimed, bounded and not: who stops earlier stops where luck made
the interval narrow. Found by simulation with the stopping (benchmarks/evaluation_coverage.py)."""
_STRETCH: Final = 2.0
"""Gain of the far side for each unit of skewness / sqrt(n) beyond chance; found likewise."""
_CENTRE: Final = 50
"""Values from whose mean the others are counted."""
_FLAT: Final = 1e-9
"""Skewness / sqrt(n) below which Hall's interval is Student's."""
_SPECK: Final = 1e-24
"""Part of the largest square under which a variance counts as 0."""


@dataclass(frozen=True, slots=True)
class Narrowing:
    """Intervals of a mean after each value, to stop at the first that is narrow enough.

    They hold as often as they say where playing stops at a width and was looked at not before
    `warm_up`; they claim nothing where it stops for other reasons. Two outcomes: Wilson's. Others:
    on each side the farther of Student's bound and Hall's, which follows the skewness.

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
        check_level(self.level, "Narrowing", most=_MOST_LEVEL)
        if self.least is None and self.most is None:
            return
        if self.least is None or self.most is None or not self.least < self.most:
            raise EvidenceError(
                "values have no such bounds",
                where="Narrowing",
                expected="least < most, or neither",
                actual=f"least={self.least}, most={self.most}",
                fix="give the bounds in this order, or leave both out",
            )

    @property
    def warm_up(self) -> int:
        """Values before which nothing is claimed: the interval is everything there is."""
        return _WARM_UP[self.least is not None]

    def sequence(self, values: Sequence[float] | FloatArray) -> tuple[FloatArray, FloatArray]:
        """[n] lower and [n] upper bounds of the mean after each value, infinite before `warm_up`.

        Raises:
            EvidenceError: a value isn't finite, or outside of the bounds.
        """
        array = self._figures(values)
        low, high = _of_any(array, self.level)
        if self.least is not None and self.most is not None:
            low, high = np.maximum(low, self.least), np.minimum(high, self.most)
        two = self._of_two(array)
        if two:
            low[two.since : two.until], high[two.since : two.until] = two.bounds(array, self.level)
        low[: self.warm_up - 1], high[: self.warm_up - 1] = -np.inf, np.inf
        return low, high

    def stop_at(self, values: Sequence[float] | FloatArray, width: float) -> int | None:
        """Number of values that suffice for an interval at most so wide; None: not these.

        Args:
            values: [n] in the order in which they were played.
            width: high - low, in the values' units, over 0.
        Raises:
            EvidenceError: as `sequence`, or the width isn't over 0.
        """
        if not width > 0:
            raise EvidenceError(
                "the width of an interval can't be 0 or less",
                where="Narrowing.stop_at",
                expected="a width over 0",
                actual=str(width),
                fix="ask for a width above 0",
            )
        low, high = self.sequence(values)
        narrow = np.flatnonzero(high - low <= width)
        return int(narrow[0]) + 1 if len(narrow) else None

    def interval(self, values: Sequence[float] | FloatArray) -> Interval:
        """The mean of all values [n] with the interval after the last.

        Raises:
            EvidenceError: as `sequence`, or there are fewer than `warm_up`.
        """
        array = self._figures(values)
        enough(len(array), self.warm_up, "values", where="Narrowing")
        two = self._of_two(array)
        how = "Wilson" if two and two.until == len(array) else "the farther of Student's and Hall's"
        low, high = self.sequence(array)
        mean, n = float(array.mean()), len(array)
        return Interval(mean, float(low[-1]), float(high[-1]), n, f"{how}, narrowing")

    def _figures(self, values: Sequence[float] | FloatArray) -> FloatArray:
        """The values, which lie within the bounds."""
        array = figures(values, "Narrowing")
        if self.least is None or self.most is None or not len(array):
            return array
        if not self.least <= array.min() <= array.max() <= self.most:
            raise EvidenceError(
                "a value is outside of its bounds",
                where="Narrowing",
                expected=f"[{self.least}, {self.most}]",
                actual=f"{array.min()} to {array.max()}",
                fix="give the bounds that hold, or none",
            )
        return array

    def _of_two(self, array: FloatArray) -> _TwoMeans | None:
        """The two outcomes that there are at first: the bounds, or the first two that are seen."""
        ends = [each for each in (self.least, self.most) if each is not None]
        if len(array) and array[0] in ends:
            since, pair = 0, ends
        else:
            # Without bounds, two outcomes are known as such only from the second one on.
            others = np.flatnonzero(array != array[0]) if len(array) else np.empty(0, np.intp)
            if not len(others):
                return None
            since, pair = int(others[0]), [float(array[0]), float(array[others[0]])]
        more = np.flatnonzero(~np.isin(array, pair))
        return _TwoMeans(min(pair), max(pair), since, int(more[0]) if len(more) else len(array))


@dataclass(frozen=True, slots=True)
class _TwoMeans:
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
    # Hall: his transformed t is what is normal; its bounds, taken back, follow the skewness.
    least = -under * np.maximum(far, -_hall(-far, lean))
    most = above * np.maximum(far, _hall(far, lean))
    return centre + one - most * error, centre + one - least * error


def _hall(t: FloatArray, lean: FloatArray) -> FloatArray:
    """The t at which Hall's transformed one is as given."""
    a = np.where(np.abs(lean) < _FLAT, _FLAT, lean)
    return np.asarray(3 / a * (np.cbrt(1 + a * (t - a / 6)) - 1))
