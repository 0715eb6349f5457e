"""Claims about a method over several environments: aggregates of runs by environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from numpy.random import Generator

from gamekeeper.core.evaluation.interval import LEVEL, Interval
from gamekeeper.core.evaluation.runs import Scores

Aggregate = Literal["mean", "iqm", "median", "optimality_gap"]


def aggregate(
    scores: Mapping[str, Scores], *, statistic: Aggregate = "iqm", target: float = 1.0
) -> float:
    """One figure for a method over environments, as rliable's `metrics`.

    mean: of all environments' means. iqm: of all runs' scores in all environments at once.
    median: over environments of their means. optimality_gap: how far scores stay under `target`.

    Args:
        scores: by environment; normalised, so that they may be put together.
        statistic: which.
        target: the score that is good enough, for the optimality gap.
    Raises:
        EvidenceError: there is no environment, or for the iqm the numbers of runs differ.
    Source: Agarwal et al. 2021; rliable 1.2.0, metrics.py.
    """
    raise NotImplementedError


def over_environments(
    scores: Mapping[str, Scores],
    *,
    statistic: Aggregate = "iqm",
    target: float = 1.0,
    rng: Generator,
    level: float = LEVEL,
) -> Interval:
    """`aggregate` with an interval: runs are resampled within each environment.

    Args:
        scores: by environment; normalised.
        statistic: which.
        target: for the optimality gap.
        rng: draws the resamples.
        level: coverage, in [0.8, 0.99].
    Returns:
        `n` is the smallest number of runs in an environment.
    Raises:
        EvidenceError: too few runs in an environment, or a figure isn't finite.
    """
    raise NotImplementedError
