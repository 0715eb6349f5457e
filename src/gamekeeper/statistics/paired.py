"""Effects over paired episodes: a mean difference with an interval that covers at its level."""

from dataclasses import asdict, dataclass
from math import comb, copysign, inf, sqrt
from statistics import NormalDist
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.interval import FloatArray, check_level, enough, figures, no_spread
from gamekeeper.statistics.one_sample import reach_of_mean
from gamekeeper.statistics.resampling import TRUSTED, Reach, extended, t_of_means
from gamekeeper.statistics.student import boundary, student, student_p

FEWEST: Final = 50
"""Pairs below which no interval is claimed: its coverage isn't what it says."""


@dataclass(frozen=True, slots=True)
class PairedEffect:
    """A mean difference over paired episodes.

    Attributes:
        value: mean of changed - base.
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
        return asdict(self)


def paired_effect(
    base: FloatArray,
    changed: FloatArray,
    *,
    rng: Generator,
    level: float = 0.95,
    is_share: bool | None = None,
    fewest: int = FEWEST,
) -> PairedEffect:
    """Mean of `changed - base` over paired episodes, with an interval.

    Differences that are all -d, 0 or d get Tango's score interval and McNemar's exact p, whatever
    their unit. Others get the bootstrap-t interval of `reach_of_mean`; its p-value is the least for
    which the interval leaves 0 out.

    Args:
        base: [episodes] a figure of each episode, unchanged, in its own units.
        changed: [episodes] the same seeds in the same order.
        level: coverage of the interval, in [0.8, 0.999].
        is_share: figures are failure and success, 0 and 1, so that d is 1 even where all
            differences are equal. False: figures have a unit, and where all differences are equal
            there is no interval. None: as the former where differences are -1, 0 and 1; else the
            interval of equal differences is that number.
        fewest: pairs that differences of several sizes ask for, `FEWEST` or more: a claim about
            episodes that are to come asks for more than one about what an intervention did.
    Raises:
        EvidenceError: there are fewer than `FEWEST` pairs, or `fewest`, the lengths differ, a
            figure isn't finite, or all differences are equal and `is_share` is False.
    Source: Tango 1998, "Equivalence test and confidence interval for the difference in proportions
        for the paired-sample design"; McNemar 1947; `reach_of_mean`.
    """
    differences = _differences(base, changed, level)
    n, value = len(differences), float(differences.mean())
    spread = float(differences.std(ddof=1))
    is_flat = spread <= 1e-12 * float(np.abs(differences).max())
    if is_flat and is_share is False:
        raise no_spread(value, n, "pairs", where="paired_effect")
    unit = _unit(differences, is_share=is_share, is_flat=is_flat)
    if unit is not None:
        more, less = int((differences > 0).sum()), int((differences < 0).sum())
        low, high = tango(more, less, n, level)
        return PairedEffect(value, unit * low, unit * high, sign_test(more, less), n)
    if is_flat:
        return PairedEffect(value, value, value, 1.0 if value == 0 else 2.0 ** (1 - n), n)
    enough(n, fewest, "pairs", where="paired_effect")
    error = spread / sqrt(n)
    standard = (differences - value) / spread
    t = np.sort(t_of_means(standard, rng))  # sorted again at every level, which is then quick
    bounds = extended(lambda level: _pair(reach_of_mean(t, standard, level)), n - 1)
    least, most = bounds(level)
    p = least_p(bounds, value / error, n - 1)
    return PairedEffect(value, value - most * error, value - least * error, p, n)


def _unit(differences: FloatArray, *, is_share: bool | None, is_flat: bool) -> float | None:
    """The one size of all differences that aren't 0; None where they have several."""
    sizes = np.unique(np.abs(differences[differences != 0]))
    are_counts = not len(sizes) or (len(sizes) == 1 and sizes[0] == 1.0)
    if is_share or (is_share is None and are_counts):
        return 1.0
    if is_flat or float(np.ptp(sizes)) > 1e-12 * float(sizes[-1]):
        return None
    return float(sizes[-1])


def _pair(found: tuple[FloatArray, FloatArray]) -> tuple[float, float]:
    return float(found[0]), float(found[1])


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
    enough(len(one), FEWEST, "pairs", where="paired_effect")
    check_level(level, "paired_effect", most=0.999)
    return figures(two - one, "paired_effect")


def tango(more: int, less: int, n: int, level: float) -> tuple[float, float]:
    """The differences of proportions that a score test doesn't reject.

    Args:
        more: pairs that differ by 1.
        less: pairs that differ by -1.
    Source: Tango 1998.
    """
    z = NormalDist().inv_cdf(0.5 + level / 2)
    value = (more - less) / n

    def score(truth: float) -> float:
        # Likeliest share of pairs that differ by -1 if the difference is `truth`: a quadratic root.
        a, b = 2 * n, (2 * n - more + less) * truth - more - less
        less_share = (sqrt(max(b * b + 4 * a * less * truth * (1 - truth), 0.0)) - b) / (2 * a)
        variance = n * (2 * less_share + truth * (1 - truth))
        off = more - less - n * truth
        return off / sqrt(variance) if variance > 0 else copysign(inf, off)

    low = -1.0 if value == -1 else boundary(lambda truth: score(truth) > z, -1.0, value)
    high = 1.0 if value == 1 else boundary(lambda truth: score(truth) > -z, value, 1.0)
    return low, high


def exact_wins(wins: int, losses: int, n: int, level: float) -> tuple[float, float]:
    """Bounds of the probability of winning, ties counting half, at any number of pairs.

    It is the mean of the chance to win and the chance not to lose, each in the exact interval of a
    share: both at `level` where there are no ties, and so the same, else at a level at which both
    hold together.

    Args:
        wins: pairs in which the first is above.
        losses: pairs in which it is below.
        level: coverage, at least.
    Source: Clopper & Pearson 1934, "The use of confidence or fiducial limits illustrated in the
        case of the binomial"; Bonferroni's inequality.
    """
    each = level if wins + losses == n else (1 + level) / 2
    won, unbeaten = _share_bounds(wins, n, each), _share_bounds(n - losses, n, each)
    return (won[0] + unbeaten[0]) / 2, (won[1] + unbeaten[1]) / 2


def _share_bounds(hits: int, n: int, level: float) -> tuple[float, float]:
    """The shares of which neither tail, up to the hits or from them on, is too rare."""
    rare = (1 - level) / 2

    def most(share: float, hits: int) -> float:
        return sum(comb(n, k) * share**k * (1 - share) ** (n - k) for k in range(hits + 1))

    low = 0.0 if hits == 0 else boundary(lambda share: 1 - most(share, hits - 1) < rare, 0.0, 1.0)
    high = 1.0 if hits == n else boundary(lambda share: most(share, hits) > rare, 0.0, 1.0)
    return low, high


def sign_test(more: int, less: int) -> float:
    """The exact two-sided p-value of both ways to differ being equally likely.

    Args:
        more: pairs in which one is above the other; less: pairs in which it is below.
    Source: McNemar 1947.
    """
    pairs = more + less
    tail = sum(comb(pairs, k) for k in range(min(more, less) + 1))
    return float(min(2 * tail / 2**pairs, 1.0))


def least_p(bounds: Reach, t: float, freedom: float) -> float:
    """One minus the highest level whose interval leaves 0 out.

    Beyond the levels that resamples tell, by Student's t on the scale of the highest of these.

    Args:
        bounds: how far the estimate is off either way, by level.
        t: the estimate, in the same unit.
        freedom: degrees of Student's t.
    """

    def leaves_out(level: float) -> bool:
        least, most = bounds(level)
        return not least <= t <= most

    if not leaves_out(TRUSTED):
        return 1 - boundary(leaves_out, 0.0, TRUSTED)
    farthest = bounds(TRUSTED)[t > 0]
    return student_p(t / abs(farthest) * student(TRUSTED, freedom), freedom) if farthest else 0.0
