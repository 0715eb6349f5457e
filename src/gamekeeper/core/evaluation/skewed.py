"""How far a mean may be off where values lean to one side, or stand in two heaps.

Bootstrap-t alone holds too little where values lean (log-normal ones: 91 % at 20) and too much
where they stand in two heaps (98 % at 14). Both are seen in the values, up to chance. The figures
below were found by simulation (benchmarks/evaluation_coverage.py).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from gamekeeper.core.evaluation.bootstrap import FloatArray, at
from gamekeeper.core.evaluation.student import student

_UPRIGHT: Final = 0.2
"""Skewness / sqrt(n) up to which nothing is stretched: so much comes by chance."""
_STRETCH: Final = 2.5
"""What the far side gains for each unit of skewness / sqrt(n) beyond that."""
_LONGEST: Final = (1.05, 3.0)
"""A bound is at most so many times as far out as Student's, and so much more for a unit of
skewness / sqrt(n): resamples of a few rare values have next to no spread."""
_LEAST_VARIANCE: Final = 1e-12
"""Of values that should have one of about 1."""
_HEAPED: Final = (0.4, 0.8, 2.0)
"""Of kurtosis - skewness^2 - 1, which is 0 for two values, 0.8 for uniform and 2 for normal ones:
from where on, and how far, a bound may be beyond Student's; and how far for skewness / sqrt(n)."""


def reach_of_mean(t: FloatArray, values: FloatArray, level: float) -> tuple[FloatArray, FloatArray]:
    """How far the t of a mean goes either way, from its resamples and the values' shape.

    Half way between the equal-tailed and the symmetric interval; then stretched on the side where
    values lean from, and cut where hardly any spread is left in resamples.

    Args:
        t: [..., resamples] of Student's t.
        values: [..., n] that were resampled, with mean 0 and spread 1.
        level: coverage.
    Returns:
        [...] the least and the most that t is, in standard errors.
    Source: Efron & Tibshirani 1993, ch. 12.5 (bootstrap-t); Hall 1988, "On symmetric bootstrap
        confidence intervals"; Chen 1995, "Testing the mean of skewed distributions", for the side
        that falls short; Pearson 1916 for kurtosis being skewness^2 + 1 at least.
    """
    ordered, both = np.sort(t, axis=-1), at(np.sort(np.abs(t), axis=-1), level)
    lean, heaped = _shape(values)
    under, above = stretches(lean, _STRETCH)
    bound = student(level, values.shape[-1] - 1)
    size = np.abs(lean)
    apart = _HEAPED[1] * np.maximum(heaped - _HEAPED[0], 0.0)
    far = _HEAPED[2] * np.maximum(size - _UPRIGHT, 0.0)
    farthest = bound * np.minimum(_LONGEST[0] + _LONGEST[1] * size, 1 + apart + far)
    least = under * (at(ordered, 0.5 - level / 2) - both) / 2
    most = above * (at(ordered, 0.5 + level / 2) + both) / 2
    return np.maximum(least, -farthest), np.minimum(most, farthest)


def stretches(lean: FloatArray, gain: float) -> tuple[FloatArray, FloatArray]:
    """By how much the least and the most that t is are stretched.

    Args:
        lean: [...] skewness / sqrt(n). Where it is over 0, rare high values are missing from most
            samples, and the mean is under the truth: the least that t is falls short.
        gain: what the far side gains for each unit of it beyond what comes by chance.
    """
    return (
        1 + gain * np.maximum(lean - _UPRIGHT, 0.0),
        1 + gain * np.maximum(-lean - _UPRIGHT, 0.0),
    )


def _shape(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Skewness / sqrt(n), and how far values are from being two."""
    off = values - values.mean(axis=-1, keepdims=True)
    square = off * off
    variance = np.maximum(square.mean(axis=-1), _LEAST_VARIANCE)
    skewness = (square * off).mean(axis=-1) / variance**1.5
    kurtosis = (square * square).mean(axis=-1) / variance**2
    return skewness / np.sqrt(values.shape[-1]), kurtosis - skewness**2 - 1
