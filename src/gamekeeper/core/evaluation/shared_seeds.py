"""The luck of the episode seeds that all runs share, which more runs don't average away."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.core.evaluation.interval import FloatArray
from gamekeeper.core.evaluation.refusals import enough
from gamekeeper.core.evaluation.student import hypotenuse, student

FEWEST_SEEDS: Final = 10
"""Shared episode seeds from which on their luck can be told."""


@dataclass(frozen=True, slots=True)
class Crossed:
    """Runs that all played the same episode seeds.

    Attributes:
        values_re: [runs, episodes].
        kept: [kept runs] those that the statistic rests on.
        weight: of their mean in the estimate.
    """

    values_re: FloatArray
    kept: NDArray[np.intp]
    weight: float


def reach_of_seeds(blocks: Sequence[Crossed], *, where: str) -> Callable[[float], float]:
    """How far the estimate may be off because of the seeds that were drawn, by level.

    Scores are run + seed + what is left; the variance of the mean over columns, less what the
    residue puts there (which the interval over runs already holds), is the seeds'.

    Args:
        blocks: of one environment, so that all have the same columns.
        where: what asks, for the error.
    Raises:
        EvidenceError: fewer seeds than `FEWEST_SEEDS`.
    Source: Searle, Casella & McCulloch 1992, ch. 4 (the two-way crossed model); Owen 2007, "The
        pigeonhole bootstrap", for resampling runs alone being too short here.
    """
    episodes = blocks[0].values_re.shape[1]
    enough(episodes, FEWEST_SEEDS, "shared episode seeds", where=where)
    together = np.zeros(episodes)
    residue = 0.0
    for block in blocks:
        rows = block.values_re[block.kept]
        together += block.weight * rows.mean(axis=0)
        residue += block.weight**2 * _residue(block.values_re) / (len(rows) * episodes)
    variance = float(together.var(ddof=1)) / episodes - residue
    error = float(np.sqrt(max(variance, 0.0)))
    return lambda level: student(level, episodes - 1) * error


def too_long(runs: float, seeds: float, freedoms: tuple[int, int], level: float) -> float:
    """What part of the hypotenuse of two Student's reaches is one's of both sources together.

    Each reaches as far as its own few degrees of freedom ask; together they have more.

    Args:
        runs: how far the estimate may be off because of the runs.
        seeds: because of the seeds.
        freedoms: degrees of both.
        level: coverage.
    Returns:
        At most 1.
    Source: Satterthwaite 1946, "An approximate distribution of estimates of variance components".
    """
    far = [student(level, freedom) for freedom in freedoms]
    squares = [float((reach / each) ** 2) for reach, each in zip((runs, seeds), far, strict=True)]
    whole = hypotenuse(runs, seeds)
    if min(squares) <= 0.0:
        return 1.0
    parts = (square**2 / freedom for square, freedom in zip(squares, freedoms, strict=True))
    freedom = sum(squares) ** 2 / sum(parts)
    return min(student(level, freedom) * sqrt(sum(squares)) / whole, 1.0)


def _residue(values_re: FloatArray) -> float:
    """The mean square of what neither run nor seed explains."""
    runs, episodes = values_re.shape
    if runs < 2:
        return 0.0
    left = values_re - values_re.mean(axis=0) - values_re.mean(axis=1)[:, None] + values_re.mean()
    return float((left**2).sum() / ((runs - 1) * (episodes - 1)))
