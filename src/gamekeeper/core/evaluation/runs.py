"""Claims about a method: statistics over its training runs, with intervals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from gamekeeper.core.evaluation.interval import (
    LEVEL,
    FloatArray,
    Interval,
    Statistic,
    check_level,
    check_statistic,
)
from gamekeeper.core.evaluation.one_sample import around
from gamekeeper.core.evaluation.refusals import FEWEST_RUNS, FEWEST_RUNS_APART, enough
from gamekeeper.core.evaluation.scores import Scores, crossed, run_scores
from gamekeeper.core.evaluation.shared_seeds import Crossed, reach_of_seeds, too_long
from gamekeeper.core.evaluation.strata import stratified, weighted_means
from gamekeeper.core.evaluation.student import hypotenuse
from gamekeeper.core.paired import Effect, least_p
from gamekeeper.errors import EvidenceError


def over_runs(
    scores: Scores,
    *,
    statistic: Statistic = "mean",
    shared_seeds: bool = True,
    rng: Generator,
    level: float = LEVEL,
) -> Interval:
    """A statistic over the scores of a method's training runs, with an interval.

    Only runs are resampled, never the episodes within them: the spread of run scores already holds
    the luck of their episodes, and resampling these too counts it twice. What all runs have in
    common, the episode seeds, is no run's luck; it is added from the columns.

    Args:
        scores: [runs, episodes], [runs] (means over many episodes), or ragged.
        statistic: of the runs' scores, each the mean over its episodes.
        shared_seeds: column k is the same episode seed in all runs, as `gamekeeper evaluate` plays
            them; the luck of the seeds is then part of the interval. Ragged scores need False, and
            the claim is then about the seeds that were played.
        rng: draws the resamples.
        level: coverage, in [0.8, 0.99].
    Raises:
        EvidenceError: fewer runs than `FEWEST_RUNS[statistic]`, fewer shared seeds than
            `FEWEST_SEEDS`, or a figure isn't finite.
    Source: Davison & Hinkley 1997, 3.8 (resampling of clusters); `around` for the interval over
        runs; Zou & Donner 2008 for putting the distances of two sources together, `too_long` for
        what this is too far.
    """
    run_means = run_scores(scores, where="over_runs")
    check_statistic(statistic, "over_runs")
    check_level(level, "over_runs")
    enough(len(run_means), FEWEST_RUNS[statistic], "training runs", where="over_runs")
    found = around(run_means, statistic=statistic, rng=rng, level=level)
    matrix = crossed(scores, where="over_runs") if shared_seeds else None
    if matrix is None:
        return found
    block = Crossed(matrix, kept_runs(run_means, statistic), 1.0)
    seeds = reach_of_seeds([block], where="over_runs")(level)
    freedoms = (len(run_means) - 1, matrix.shape[1] - 1)
    part = too_long((found.high - found.low) / 2, seeds, freedoms, level)
    low = found.value - part * hypotenuse(found.value - found.low, seeds)
    high = found.value + part * hypotenuse(found.high - found.value, seeds)
    return Interval(found.value, low, high, found.n, f"{found.method}, and of shared seeds")


def difference_over_runs(
    a: Scores,
    b: Scores,
    *,
    shared_seeds: bool = True,
    rng: Generator,
    level: float = LEVEL,
) -> Effect:
    """The mean of `b - a` over training runs of two methods, with an interval and a p-value.

    The bootstrap-t of the two samples' difference in mean, runs being resampled within each.

    Args:
        a: [runs, episodes], [runs] or ragged, of one method.
        b: of the other; it may have another number of runs.
        shared_seeds: column k is the same episode seed in all runs of both.
        rng: draws the resamples.
        level: coverage, in [0.8, 0.99].
    Returns:
        value, low, high and p; `n` is the smaller number of runs. `b - a`, as `paired_effect`. The
        p-value is the least for which the interval leaves 0 out, and no less than 2 / 5,000.
    Raises:
        EvidenceError: fewer runs than `FEWEST_RUNS_APART` of either, seeds that aren't shared,
            or a figure isn't finite.
    Source: `stratified` and `reach_of_seeds`, put together as in `over_runs`.
    """
    where = "difference_over_runs"
    check_level(level, where)
    strata = [run_scores(each, where=where) for each in (a, b)]
    runs = min(map(len, strata))
    enough(runs, FEWEST_RUNS_APART, "training runs of each method", where=where)
    found = stratified(strata, weighted_means([-1.0, 1.0]), rng)
    seeds = _seeds_of_both(a, b) if shared_seeds else _no_seeds

    def off(level: float) -> tuple[float, float]:
        """How far the estimate is above the truth, at least and at most."""
        least, most = found.bounds(level) if found.bounds else (0.0, 0.0)
        luck = seeds(level)
        return -hypotenuse(least * found.error, luck), hypotenuse(most * found.error, luck)

    least, most = off(level)
    value = found.value
    if most == least:  # nothing varied
        return Effect(value, value, value, 1.0 if value == 0 else 2.0 ** (1 - runs), runs)
    return Effect(value, value - most, value - least, least_p(off, value), runs)


def _no_seeds(level: float) -> float:
    """Runs on seeds of their own hold the seeds' luck already."""
    return 0.0


def _seeds_of_both(a: Scores, b: Scores) -> Callable[[float], float]:
    where = "difference_over_runs"
    one, two = crossed(a, where=where), crossed(b, where=where)
    if one is None or two is None:
        return _no_seeds
    if one.shape[1] != two.shape[1]:
        raise EvidenceError(
            "two methods didn't play the same seeds",
            where=where,
            expected="equally many episodes, column for column on one seed",
            seen=f"{one.shape[1]} and {two.shape[1]}",
            mend="play the same seeds, or say shared_seeds=False",
        )
    blocks = [Crossed(one, np.arange(len(one)), -1.0), Crossed(two, np.arange(len(two)), 1.0)]
    return reach_of_seeds(blocks, where=where)


def kept_runs(run_means: FloatArray, statistic: Statistic) -> NDArray[np.intp]:
    """The runs that a statistic rests on.

    Args:
        run_means: [runs] scores.
        statistic: which.
    Returns:
        [kept runs] their places.
    """
    order, n = np.argsort(run_means, kind="stable"), len(run_means)
    cut = {"mean": 0, "iqm": n // 4, "median": (n - 1) // 2}[statistic]
    return order[cut : n - cut]
