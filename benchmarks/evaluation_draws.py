"""The distributions that `evaluation_coverage.py` draws returns and scores from."""

from collections.abc import Callable
from math import exp
from typing import Any

from numpy.random import Generator

Draw = Callable[[Generator, Any], Any]


def two_peaks(high: float, spread: float) -> Draw:
    """Values around 0, and so many of them around 5."""
    return lambda rng, size: 5.0 * (rng.random(size) < high) + rng.normal(0, spread, size)


DRAWS: dict[str, Draw] = {
    "normal": lambda rng, size: rng.normal(0, 1, size),
    "uniform": lambda rng, size: rng.random(size),
    "exponential": lambda rng, size: rng.exponential(1, size),
    "log-normal 0.5": lambda rng, size: rng.lognormal(0, 0.5, size),
    "log-normal 1": lambda rng, size: rng.lognormal(0, 1, size),
    "log-normal 2": lambda rng, size: rng.lognormal(0, 2, size),
    "Student's t, 3": lambda rng, size: rng.standard_t(3, size),
    "two peaks, even": two_peaks(0.5, 1),
    "two peaks, 80 %": two_peaks(0.8, 1),
    "success, 80 %": lambda rng, size: (rng.random(size) < 0.8) * 1.0,
    "shares, mean 0.8": lambda rng, size: rng.binomial(50, rng.beta(4, 1, size)) / 50,
    "shares, mean 0.95": lambda rng, size: rng.binomial(50, rng.beta(19, 1, size)) / 50,
    "counts, mean 1": lambda rng, size: rng.poisson(1, size) * 1.0,
    "deliveries and energy": lambda rng, size: (
        5.0 * rng.binomial(8, 0.7, size) - 0.01 * rng.normal(100, 30, size)
    ),
    "60 % zeros": lambda rng, size: rng.choice([0.0, 1.0, 2.0], p=[0.6, 0.2, 0.2], size=size),
}
STOPPED: dict[str, Draw] = DRAWS | {
    "success, 50 %": lambda rng, size: (rng.random(size) < 0.5) * 1.0,
    "5 in 3 % of episodes": lambda rng, size: (rng.random(size) < 0.03) * 5.0,
}
FRESH: dict[str, Draw] = {
    "gamma 0.5": lambda rng, size: rng.gamma(0.5, 1, size),
    "gamma 3, mirrored": lambda rng, size: -rng.gamma(3, 1, size),
    "Laplace": lambda rng, size: rng.laplace(0, 1, size),
    "beta 0.5, 0.5": lambda rng, size: rng.beta(0.5, 0.5, size),
    "Weibull 0.8": lambda rng, size: rng.weibull(0.8, size),
    "Lomax 5": lambda rng, size: rng.pareto(5, size),
    "three peaks": lambda rng, size: rng.choice([0.0, 4.0, 10.0], size) + rng.normal(0, 0.5, size),
    "a crash in 10": lambda rng, size: rng.normal(5, 1, size) - 10.0 * (rng.random(size) < 0.1),
    "negative binomial 2": lambda rng, size: rng.negative_binomial(2, 0.3, size) * 1.0,
}
"""On which no interval's constants were chosen."""
TAILS: dict[str, Draw] = {
    "log-normal 1.5": lambda rng, size: rng.lognormal(0, 1.5, size),
    "log-normal 3": lambda rng, size: rng.lognormal(0, 3, size),
    "Lomax 2.5": lambda rng, size: rng.pareto(2.5, size),
    "Lomax 1.5": lambda rng, size: rng.pareto(1.5, size),
}
MEANS = {
    "log-normal 1.5": exp(1.125),
    "log-normal 3": exp(4.5),
    "Lomax 2.5": 1 / 1.5,
    "Lomax 1.5": 2.0,
}
"""Of these, which no sample tells well; the variance of the last is infinite."""
