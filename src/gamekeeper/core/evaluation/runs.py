"""Claims about a method: statistics over its training runs, with intervals."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.random import Generator

from gamekeeper.core.evaluation.interval import LEVEL, FloatArray, Interval, Statistic
from gamekeeper.core.paired import Effect

Scores = FloatArray | Sequence[float] | Sequence[FloatArray] | Sequence[Sequence[float]]
"""[runs] a score of each, [runs, episodes], or a list of runs with different numbers of episodes."""


def run_scores(scores: Scores, *, where: str = "run_scores") -> FloatArray:
    """The score of each run: the mean over its episodes.

    Args:
        scores: [runs], [runs, episodes], or ragged.
        where: what asks, for the error.
    Raises:
        EvidenceError: there is no run, a run without episodes, or a figure that isn't finite.
    """
    raise NotImplementedError


def over_runs(
    scores: Scores,
    *,
    statistic: Statistic = "mean",
    shared_seeds: bool = True,
    rng: Generator,
    level: float = LEVEL,
) -> Interval:
    """A statistic over the scores of a method's training runs, with an interval.

    Args:
        scores: [runs, episodes], [runs] (means over many episodes), or ragged.
        statistic: of the runs' scores, each the mean over its episodes.
        shared_seeds: column k is the same episode seed in all runs, as `gamekeeper evaluate` plays
            them; the luck of the seeds is then part of the interval. Ragged scores need False.
        rng: draws the resamples.
        level: coverage, in [0.8, 0.99].
    Raises:
        EvidenceError: fewer runs than `FEWEST_RUNS[statistic]`, or a figure isn't finite.
    """
    raise NotImplementedError


def difference_over_runs(
    a: Scores,
    b: Scores,
    *,
    shared_seeds: bool = True,
    level: float = LEVEL,
) -> Effect:
    """The mean of `b - a` over training runs of two methods, with an interval and a p-value.

    Args:
        a: [runs, episodes], [runs] or ragged, of one method.
        b: of the other; it may have another number of runs.
        shared_seeds: column k is the same episode seed in all runs of both.
        level: coverage, in [0.8, 0.99].
    Returns:
        value, low, high and p; `n` is the smaller number of runs. `b - a`, as `paired_effect`.
    Raises:
        EvidenceError: fewer runs than `FEWEST_RUNS["mean"]` of either, or a figure isn't finite.
    """
    raise NotImplementedError
