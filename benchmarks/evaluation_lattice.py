"""What any interval covers at least where outcomes are few, so that coverage jumps.

A bound may leave a truth out only for samples that a truth still farther off would hardly give,
or it would be wrong there. Where these samples are rare at this truth, every interval covers it.
"""

from typing import Any

import numpy as np

from gamekeeper.statistics.student import binomial_at_most

LOWEST = 0.93
"""What an interval has to cover everywhere."""


def of_quantile(n: int, part: float, under: float, upto: float) -> float:
    """The least coverage of a quantile, in percent.

    For intervals whose bounds rise with the values and that cover `LOWEST` for every distribution.
    The lower bound is over the quantile for samples with so many values above it, and no
    distribution with this quantile puts more than 1 - part there; likewise the upper one. What
    both may miss together at the worst distribution bounds what they miss at this one.

    Args:
        n: values.
        part: of the quantile.
        under: chance of a value under the quantile.
        upto: chance of one at most the quantile.
    """
    places = range(n + 2)
    worst_high, here_high, worst_low, here_low = (
        np.array([_at_least(place, n, chance) for place in places])
        for chance in (1 - part, 1 - upto, part, under)
    )
    allowed = worst_high[:, None] + worst_low <= 1 - LOWEST
    return float(100 * (1 - (here_high[:, None] + here_low)[allowed].max()))


def of_iqm_of_two(n: int, chance: float) -> float:
    """The least coverage of the interquartile mean of two outcomes, where that is an end.

    It is 1 for every chance of 0.75 and more, so that an interval may end below 1 only for so few
    hits as a chance of 0.75 hardly gives.

    Args:
        n: values.
        chance: of the higher outcome, 0.75 and more.
    """
    few = max((k for k in range(-1, n) if binomial_at_most(k, n, 0.75) <= 1 - LOWEST), default=-1)
    return 100 * (1 - binomial_at_most(few, n, chance))


def of_estimates(estimates: Any, truth: float) -> float:
    """The least coverage of 93 % and more that intervals can have which rise with the estimate.

    Such intervals leave the truth out for the lowest estimates and for the highest.

    Args:
        estimates: [experiments] at this truth.
        truth: that they estimate.
    """
    seen, many = np.unique(np.round(estimates, 9), return_counts=True)
    below = np.concatenate([[0.0], np.cumsum(many[seen < truth]) / len(estimates)])
    above = np.concatenate([[0.0], np.cumsum(many[seen > truth][::-1]) / len(estimates)])
    missed = (below[:, None] + above).ravel()
    return float(100 * (1 - missed[missed <= 1 - LOWEST].max()))


def _at_least(hits: int, n: int, chance: float) -> float:
    return 1.0 - binomial_at_most(hits - 1, n, chance)
