"""The stratified bootstrap-t: runs are resampled within each environment or method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from gamekeeper.core.evaluation.bootstrap import CHUNK, RESAMPLES, Reach, reach
from gamekeeper.core.evaluation.interval import FloatArray
from gamekeeper.core.evaluation.iqm import middle

Estimate = Callable[[Sequence[FloatArray]], tuple[FloatArray, FloatArray]]
"""[..., runs] of each stratum -> the estimate [...], and its variance by stratum [..., strata]."""


@dataclass(frozen=True, slots=True)
class Stratified:
    """An estimate over strata and how far its t goes.

    Attributes:
        value: the estimate.
        error: its standard error.
        bounds: how far t goes either way, by level; None where nothing varied.
    """

    value: float
    error: float
    bounds: Reach | None


def weighted_means(weights: Sequence[float]) -> Estimate:
    """The weighted sum of strata's means.

    Args:
        weights: one for each stratum; -1 and 1 make a difference.
    """

    def estimate(strata: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        pairs = list(zip(weights, strata, strict=True))
        value = sum(weight * each.mean(axis=-1) for weight, each in pairs)
        variances = [w * w * each.var(axis=-1, ddof=1) / each.shape[-1] for w, each in pairs]
        return np.asarray(value), np.stack(variances, axis=-1)

    return estimate


def pooled_iqm(strata: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """The interquartile mean of all strata's values at once, and its variance by stratum.

    The variance is that of the values drawn in to the quartiles (winsorised), within strata.

    Args:
        strata: [..., runs] of each, equally many runs.
    Source: Tukey & McLaughlin 1963, for the variance of a trimmed mean.
    """
    kept = middle(np.concatenate(strata, axis=-1))
    low, high = kept.min(axis=-1)[..., None], kept.max(axis=-1)[..., None]
    drawn_in = [np.clip(each, low, high).var(axis=-1, ddof=1) * each.shape[-1] for each in strata]
    return kept.mean(axis=-1), np.stack(drawn_in, axis=-1) / kept.shape[-1] ** 2


def stratified(strata: Sequence[FloatArray], estimate: Estimate, rng: Generator) -> Stratified:
    """An estimate with the bootstrap distribution of its t, resampled within strata.

    Args:
        strata: [runs] of each, two at least.
        estimate: of all.
        rng: draws the resamples.
    Source: Davison & Hinkley 1997, 3.2 (several samples); Satterthwaite 1946 for the degrees of
        freedom of the bound on t.
    """
    value, variances = estimate(strata)
    variance = float(variances.sum())
    largest = max(float(np.abs(each).max()) for each in strata)
    if variance <= (1e-12 * largest) ** 2:
        return Stratified(float(value), 0.0, None)
    t = np.empty(RESAMPLES)
    step = max(CHUNK // sum(map(len, strata)), 1)
    for start in range(0, RESAMPLES, step):
        many = min(step, RESAMPLES - start)
        drawn = [each[rng.integers(0, len(each), (many, len(each)))] for each in strata]
        values, spreads = estimate(drawn)
        errors = np.sqrt(np.maximum(spreads.sum(axis=-1), 1e-12 * variance))
        t[start : start + many] = (values - value) / errors
    degrees = np.array([len(each) - 1 for each in strata])
    freedom = variance**2 / float((variances**2 / degrees).sum())
    return Stratified(float(value), variance**0.5, reach(t, freedom))
