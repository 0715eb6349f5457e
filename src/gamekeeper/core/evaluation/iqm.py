"""The interquartile mean, also of many samples at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.random import Generator

from gamekeeper.core.evaluation.bootstrap import CHUNK, RESAMPLES
from gamekeeper.core.evaluation.interval import FloatArray, figures
from gamekeeper.core.evaluation.refusals import enough


def interquartile_mean(values: Sequence[float] | FloatArray) -> float:
    """The mean of what is left without the lowest and highest quarter.

    A quarter is `n // 4` values, so that for any n it is what rliable and SciPy's `trim_mean`
    give.

    Args:
        values: [n], one at least.
    Raises:
        EvidenceError: there are none, or one isn't finite.
    Source: Agarwal et al. 2021, "Deep reinforcement learning at the edge of the statistical
        precipice".
    """
    ordered = figures(values, "interquartile_mean")
    enough(len(ordered), 1, "values", where="interquartile_mean")
    return float(middle(ordered).mean())


def middle(samples: FloatArray) -> FloatArray:
    """What is left of each sample without its lowest and highest quarter, in no order.

    Args:
        samples: [..., n].
    Returns:
        [..., n - 2 * (n // 4)].
    """
    n = samples.shape[-1]
    cut = n // 4
    if cut == 0:
        return samples
    return np.partition(samples, (cut, n - cut - 1), axis=-1)[..., cut : n - cut]


def resampled_iqm(values: FloatArray, rng: Generator) -> FloatArray:
    """The interquartile mean of each of many resamples.

    Args:
        values: [n].
        rng: draws the resamples.
    Returns:
        [resamples].
    """
    n = len(values)
    found = np.empty(RESAMPLES)
    step = max(CHUNK // n, 1)
    for start in range(0, RESAMPLES, step):
        drawn = values[rng.integers(0, n, (min(step, RESAMPLES - start), n))]
        found[start : start + step] = middle(drawn).mean(axis=1)
    return found
