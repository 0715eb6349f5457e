"""Quantiles and tails of Student's and the binomial distribution, without SciPy."""

from collections.abc import Callable
from math import exp, lgamma, log, log1p, pi, sqrt
from statistics import NormalDist
from typing import Any, Final

_HALVINGS: Final = 60
"""Bisections of a bound; more digits than a float has."""
_TERMS: Final = 300
"""Terms of the continued fraction; it has converged long before."""
_TINY: Final = 1e-300
_SERIES_FROM: Final = 30
"""Degrees of freedom from which on a series gives Student's quantiles."""


def incomplete_beta(a: float, b: float, x: float) -> float:
    """The chance that a beta(a, b) variable is at most x.

    Args:
        a: over 0.
        b: over 0.
        x: in [0, 1].
    Source: Press et al. 2007, "Numerical recipes", 6.4 (Lentz's continued fraction).
    """
    if x <= 0.0 or x >= 1.0:
        return 0.0 if x <= 0.0 else 1.0
    # Above the mean the fraction converges slowly; the other tail, mirrored, converges fast.
    if x > (a + 1) / (a + b + 2):
        return 1.0 - incomplete_beta(b, a, 1.0 - x)
    front = exp(lgamma(a + b) - lgamma(a) - lgamma(b) + a * log(x) + b * log1p(-x))
    return front * _fraction(a, b, x) / a


def _fraction(a: float, b: float, x: float) -> float:
    """The continued fraction of the incomplete beta function, by Lentz's method."""
    c, d = 1.0, 1.0 / (_away(1.0 - (a + b) * x / (a + 1)))
    value = d
    for m in range(1, _TERMS):
        # The coefficients d(2m) and d(2m + 1) of formula 6.4.6.
        even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        for term in (even, odd):
            d = 1.0 / _away(1.0 + term * d)
            c = _away(1.0 + term / c)
            value *= c * d
        if abs(c * d - 1.0) < 1e-15:
            break
    return value


def _away(value: float) -> float:
    """A divisor that isn't 0."""
    return value if abs(value) > _TINY else _TINY


def student_p(t: float, freedom: float) -> float:
    """The two-sided p-value of Student's t; `freedom` is over 0 and needn't be whole."""
    return incomplete_beta(freedom / 2, 0.5, freedom / (freedom + t * t))


def student(level: float, freedom: float) -> float:
    """Number of standard errors that Student's two-sided interval of a level reaches.

    Args:
        level: coverage, in (0, 1).
        freedom: degrees, 1 and more; needn't be whole.
    Source: from 30 degrees on Abramowitz & Stegun 1964, 26.7.5 (off by 2e-4 at most for a level of
        0.99); below by Newton's method, which comes from one side because the tail is convex.
    """
    z = NormalDist().inv_cdf(0.5 + level / 2)
    if freedom >= _SERIES_FROM:
        return float(series(z, freedom))
    half = (freedom + 1) / 2
    scale = lgamma(half) - lgamma(freedom / 2) - log(freedom * pi) / 2
    t = z
    for _ in range(_HALVINGS):
        density = exp(scale - half * log1p(t * t / freedom))
        # Both tails together fall by twice the density.
        step = (student_p(t, freedom) - (1 - level)) / (2 * density)
        t += step
        if step <= 1e-12 * t:
            break
    return t


def series(z: float, freedom: Any) -> Any:
    """Student's quantile by the normal one, for 30 degrees and more, a number or an array.

    Source: Abramowitz & Stegun 1964, 26.7.5.
    """
    first = (z**3 + z) / 4
    second = (5 * z**5 + 16 * z**3 + 3 * z) / 96
    return z + first / freedom + second / freedom**2


def binomial_at_most(hits: int, trials: int, p: float) -> float:
    """The chance of no more than so many hits (-1 and more) in so many trials."""
    if hits < 0:
        return 0.0
    return 1.0 if hits >= trials else incomplete_beta(trials - hits, hits + 1, 1.0 - p)


def normal_tail(distance: float) -> float:
    """The chance of a normal variable being farther than that below its mean."""
    return NormalDist().cdf(-distance)


def boundary(is_before: Callable[[float], bool], low: float, high: float) -> float:
    """Point where a claim that holds from `low` on stops to hold."""
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if is_before(middle) else (low, middle)
    return (low + high) / 2


def hypotenuse(*sides: float) -> float:
    """Independent distances put together: the root of the sum of their squares."""
    return sqrt(sum(side * side for side in sides))
