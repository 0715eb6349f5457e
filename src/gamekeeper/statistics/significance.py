"""Statistics that checks and measurements state: intervals of shares, permutation tests, Holm."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb, sqrt
from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.interval import LEVEL

FloatArray = NDArray[np.float64]

ROUNDS: Final = 999
"""Permutations that are drawn; the least p-value is then 1 / 1,000."""


@dataclass(frozen=True, slots=True)
class Share:
    """Share of trials in which an event happened, with an interval.

    Attributes:
        p: hits in trials; 0 where there was no trial.
        high: upper bound.
    """

    p: float
    low: float
    high: float
    n: int


def p_text(p: float) -> str:
    """`p = 0.012`, or `p < 0.001`: what is smaller rests on assumptions, not on data."""
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def wilson(hits: int, trials: int, *, level: float = LEVEL) -> Share:
    """The share of hits with Wilson's score interval, which covers for small counts too.

    Args:
        hits: in [0, trials].
        trials: without any the interval is [0, 1].
        level: coverage, in (0, 1).
    Raises:
        EvidenceError: more hits than trials, or a negative count.
    Source: Wilson 1927; Brown, Cai & DasGupta 2001, "Interval estimation for a binomial
        proportion".
    """
    _counted(hits, trials)
    if trials == 0:
        return Share(0.0, 0.0, 1.0, 0)
    z = NormalDist().inv_cdf(0.5 + level / 2)
    p = hits / trials
    centre = p + z * z / (2 * trials)
    spread = z * sqrt(p * (1 - p) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    low = 0.0 if hits == 0 else max((centre - spread) / scale, 0.0)
    high = 1.0 if hits == trials else min((centre + spread) / scale, 1.0)
    return Share(p, low, high, trials)


def permutation_test(
    one: FloatArray, two: FloatArray, *, rng: Generator, rounds: int = ROUNDS
) -> float:
    """The p-value of two samples having one distribution, by their means in all features at once.

    The statistic is the largest difference of means over the features, each in units of its
    standard deviation over both samples, so that one p-value covers all features: the chance of
    p <= a is at most a where the distributions are equal.

    Args:
        one: [samples, features].
        two: [samples, features].
    Raises:
        EvidenceError: the features aren't the same, or a sample is empty.
    Source: Westfall & Young 1993, "Resampling-based multiple testing" (max-T); Phipson & Smyth 2010
        for the 1 added to both counts.
    """
    if one.ndim != 2 or two.ndim != 2 or one.shape[1] != two.shape[1] or not len(one) * len(two):
        raise EvidenceError(
            "two samples can't be compared",
            where="permutation_test",
            expected="[samples, features] twice, with the same features and a sample at least",
            actual=f"{one.shape} and {two.shape}",
            fix="hand in two arrays with the same features",
        )
    values = _standardised(np.concatenate([one, two]))
    if values.shape[1] == 0:
        return 1.0
    # Values times these signs give the difference of both means, whichever way they are dealt.
    signs = np.concatenate([np.full(len(one), 1 / len(one)), np.full(len(two), -1 / len(two))])
    drawn = rng.permuted(np.tile(signs, (rounds, 1)), axis=1)
    seen = np.abs(signs @ values).max()
    others = np.abs(drawn @ values).max(axis=1)
    return float((1 + np.count_nonzero(others >= seen - 1e-12)) / (rounds + 1))


def sign_flip_test(differences: FloatArray, *, rng: Generator, rounds: int = ROUNDS) -> float:
    """The p-value of paired differences being as likely one way as the other, in all features.

    Args:
        differences: [pairs, features].
    Raises:
        EvidenceError: it isn't [pairs, features], or there is no pair.
    Source: Winkler et al. 2014, "Permutation inference for the general linear model" (sign
        flipping), with the largest statistic as in `permutation_test`.
    """
    if differences.ndim != 2 or not len(differences):
        raise EvidenceError(
            "pairs can't be compared",
            where="sign_flip_test",
            expected="[pairs, features], a pair at least",
            actual=str(differences.shape),
            fix="hand in at least one pair",
        )
    size = np.sqrt((differences**2).sum(axis=0))
    values = differences[:, size > 0] / size[size > 0]
    if values.shape[1] == 0:
        return 1.0
    drawn = rng.choice(np.array([-1.0, 1.0]), size=(rounds, len(values)))
    seen = np.abs(values.sum(axis=0)).max()
    others = np.abs(drawn @ values).max(axis=1)
    return float((1 + np.count_nonzero(others >= seen - 1e-12)) / (rounds + 1))


def fisher_exact(hits: int, trials: int, other_hits: int, other_trials: int) -> float:
    """P-value of two shares being one, two-sided and exact, so that it holds for small counts.

    Args:
        hits: in [0, trials]; other_hits likewise.
    Raises:
        EvidenceError: more hits than trials, or a negative count.
    Source: Fisher 1935, "The logic of inductive inference"; both tails as the sum of all tables
        with the same margins that are no likelier than the one seen.
    """
    _counted(hits, trials)
    _counted(other_hits, other_trials)
    total = hits + other_hits
    ways = {
        k: comb(trials, k) * comb(other_trials, total - k)
        for k in range(max(0, total - other_trials), min(trials, total) + 1)
    }
    return sum(count for count in ways.values() if count <= ways[hits]) / sum(ways.values())


def holm(p_values: Sequence[float]) -> tuple[float, ...]:
    """The p-values corrected for their number, so that the chance of any false one stays bounded.

    Source: Holm 1979, "A simple sequentially rejective multiple test procedure".
    """
    order = sorted(range(len(p_values)), key=p_values.__getitem__)
    corrected = [1.0] * len(p_values)
    largest = 0.0
    for rank, place in enumerate(order):
        # The running maximum keeps a test from being corrected below one with a smaller p-value.
        largest = max(largest, min((len(p_values) - rank) * p_values[place], 1.0))
        corrected[place] = largest
    return tuple(corrected)


def _counted(hits: int, trials: int) -> None:
    if not 0 <= hits <= trials:
        raise EvidenceError(
            "there are more hits than trials, or fewer than none",
            where="stats",
            expected="0 <= hits <= trials",
            actual=f"{hits} of {trials}",
            fix="count hits among the trials",
        )


def _standardised(values: FloatArray) -> FloatArray:
    """The features that vary, each with standard deviation 1."""
    spread = values.std(axis=0)
    varied = spread > 1e-12 * np.maximum(np.abs(values).max(axis=0, initial=0.0), 1e-300)
    return np.asarray(values[:, varied] / spread[varied])
