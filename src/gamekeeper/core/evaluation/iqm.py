"""The interquartile mean, and how far it is off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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
    ordered = np.sort(figures(values, "interquartile_mean"))
    enough(len(ordered), 1, "values", where="interquartile_mean")
    cut = len(ordered) // 4
    return float(ordered[cut : len(ordered) - cut].mean())
