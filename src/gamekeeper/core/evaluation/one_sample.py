"""Claims about one checkpoint: a statistic over its episodes, with an interval."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.random import Generator

from gamekeeper.core.evaluation.interval import LEVEL, FloatArray, Interval, Statistic


def one_sample(
    values: Sequence[float] | FloatArray,
    *,
    statistic: Statistic = "mean",
    rng: Generator,
    level: float = LEVEL,
) -> Interval:
    """A statistic over the episodes of one checkpoint, with an interval.

    Args:
        values: [episodes] one figure of each.
        statistic: "mean", "iqm" or "median".
        rng: draws the resamples.
        level: coverage, in [0.8, 0.99].
    Raises:
        EvidenceError: fewer episodes than `FEWEST_EPISODES[statistic]`, or one isn't finite.
    """
    raise NotImplementedError
