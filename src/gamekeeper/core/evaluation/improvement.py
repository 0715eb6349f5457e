"""The probability that one beats the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, sqrt
from statistics import NormalDist

import numpy as np

from gamekeeper.core.evaluation.interval import (
    LEVEL,
    FloatArray,
    Interval,
    check_level,
    figures,
)
from gamekeeper.core.evaluation.refusals import FEWEST_PAIRS, FEWEST_RUNS_APART, enough
from gamekeeper.core.evaluation.student import crossing, hypotenuse, student
from gamekeeper.core.paired import tango
from gamekeeper.core.stats import wilson
from gamekeeper.errors import EvidenceError

Figures = Sequence[float] | FloatArray
_WHERE = "improvement"


def probability_of_improvement(a: Figures, b: Figures) -> float:
    """The chance that a value of `a` is above one of `b`, ties counting half (Mann-Whitney).

    Args:
        a: [n].
        b: [m].
    Raises:
        EvidenceError: one has no values, or a value isn't finite.
    Source: Agarwal et al. 2021; Mann & Whitney 1947.
    """
    one, two = figures(a, _WHERE), np.sort(figures(b, _WHERE))
    enough(min(len(one), len(two)), 1, "values", where=_WHERE)
    under = np.searchsorted(two, one, side="left") + np.searchsorted(two, one, side="right")
    return float(under.sum() / (2 * len(one) * len(two)))


def improvement(
    a: Figures | Mapping[str, Figures],
    b: Figures | Mapping[str, Figures],
    *,
    paired: bool,
    level: float = LEVEL,
) -> Interval:
    """The probability that `a` beats `b`, ties counting half, with an interval.

    Not paired: Newcombe's interval for the Mann-Whitney statistic, its variance less by what ties
    take from it; where only two values occur, Wilson's intervals of both shares. Paired: Tango's
    score interval of wins less losses. Over several environments the distances are put together,
    and Newcombe's reach by Student's quantile, without which they cover too little.

    Args:
        a: [n] scores of runs (not paired), or figures of episodes on shared seeds (paired); or such
            by environment, and then the mean over environments, as in rliable.
        b: of the other; equally many where paired.
        paired: value k of `a` meets value k of `b` alone.
        level: coverage, in [0.8, 0.99].
    Returns:
        `n` is the number of pairs, or the smaller number of values, in the least environment.
    Raises:
        EvidenceError: fewer than 10 values (50 pairs), different environments, or pairs that don't
            match.
    Source: Newcombe 2006, "Confidence intervals for an effect size measure based on the
        Mann-Whitney statistic, part 2", method 5; Newcombe 1998, method 10; Tango 1998; Zou &
        Donner 2008 (MOVER).
    """
    check_level(level, _WHERE)
    ones, twos = _by_environment(a), _by_environment(b)
    if list(ones) != list(twos) and set(ones) != set(twos):
        raise EvidenceError(
            "two methods played different environments",
            where=_WHERE,
            expected=", ".join(ones),
            seen=", ".join(twos),
        )
    many = len(ones)
    if paired:
        found = [_paired(ones[name], twos[name], level) for name in ones]
    else:
        found = [_independent(ones[name], twos[name], level, many > 1) for name in ones]
    value = sum(each.value for each in found) / many
    low = value - hypotenuse(*(each.value - each.low for each in found)) / many
    high = value + hypotenuse(*(each.high - each.value for each in found)) / many
    return Interval(value, low, high, min(each.n for each in found), found[0].method)


def _by_environment(values: Figures | Mapping[str, Figures]) -> dict[str, FloatArray]:
    if not isinstance(values, Mapping):
        return {"": figures(values, _WHERE)}
    enough(len(values), 1, "environments", where=_WHERE)
    return {name: figures(each, f"{_WHERE}, {name}") for name, each in values.items()}


def _paired(a: FloatArray, b: FloatArray, level: float) -> Interval:
    if a.shape != b.shape:
        raise EvidenceError(
            "values can't be paired",
            where=_WHERE,
            expected="equally many, on the same seeds",
            seen=f"{len(a)} and {len(b)}",
        )
    enough(len(a), FEWEST_PAIRS, "pairs", where=_WHERE)
    wins, losses = int((a > b).sum()), int((a < b).sum())
    low, high = tango(wins, losses, len(a), level)
    value = 0.5 + (wins - losses) / len(a) / 2
    return Interval(value, 0.5 + low / 2, 0.5 + high / 2, len(a), "Tango, of wins less losses")


def _independent(a: FloatArray, b: FloatArray, level: float, is_one_of_many: bool) -> Interval:
    """One environment; of many the normal quantile gives too little, by simulation."""
    n = min(len(a), len(b))
    enough(n, FEWEST_RUNS_APART, "values of each", where=_WHERE)
    value = probability_of_improvement(a, b)
    seen, counts = np.unique(np.concatenate([a, b]), return_counts=True)
    if len(seen) <= 2:
        one, two = (
            wilson(int((each == seen[-1]).sum()), len(each), level=level) for each in (a, b)
        )
        low = value - hypotenuse(one.p - one.low, two.high - two.p) / 2
        high = value + hypotenuse(one.high - one.p, two.p - two.low) / 2
        return Interval(value, low, high, n, "Newcombe, of two shares")
    both = len(a) + len(b)
    untied = 1 - float((counts**3.0 - counts).sum()) / (both**3 - both)
    z = student(level, both - 2) if is_one_of_many else NormalDist().inv_cdf(0.5 + level / 2)
    low, high = _newcombe(value, len(a), len(b), untied, z)
    return Interval(value, low, high, n, "Newcombe, of Mann-Whitney")


def _newcombe(value: float, n: int, m: int, untied: float, z: float) -> tuple[float, float]:
    """The chances that a score test with the exponential model's variance doesn't reject."""
    half = (n + m) / 2 - 1

    def score(truth: float) -> float:
        spread = half * ((1 - truth) / (2 - truth) + truth / (1 + truth))
        variance = truth * (1 - truth) * (1 + spread) / (n * m) * untied
        off = value - truth
        if variance <= 0:
            return 0.0 if off == 0 else inf * off
        return off / sqrt(variance)

    low = 0.0 if value <= 0 else crossing(lambda truth: score(truth) > z, 0.0, value)
    high = 1.0 if value >= 1 else crossing(lambda truth: score(truth) > -z, value, 1.0)
    return low, high
