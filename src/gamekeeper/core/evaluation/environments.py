"""Claims about a method over several environments: aggregates of runs by environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, Literal

import numpy as np
from numpy.random import Generator

from gamekeeper.core.evaluation.bootstrap import CHUNK, RESAMPLES, expanded
from gamekeeper.core.evaluation.interval import LEVEL, FloatArray, Interval, check_level
from gamekeeper.core.evaluation.iqm import interquartile_mean
from gamekeeper.core.evaluation.one_sample import around
from gamekeeper.core.evaluation.refusals import (
    FEWEST_RUNS,
    FEWEST_RUNS_EACH,
    FEWEST_RUNS_FOR_MEDIANS,
    FEWEST_RUNS_TOGETHER,
    enough,
)
from gamekeeper.core.evaluation.scores import Scores, run_scores
from gamekeeper.core.evaluation.strata import pooled_iqm, stratified, weighted_means
from gamekeeper.errors import EvidenceError

Aggregate = Literal["mean", "iqm", "median", "optimality_gap"]
AGGREGATES: Final[tuple[Aggregate, ...]] = ("mean", "iqm", "median", "optimality_gap")


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
    return _aggregate(_strata(scores, statistic, "aggregate"), statistic, target)


def over_environments(
    scores: Mapping[str, Scores],
    *,
    statistic: Aggregate = "iqm",
    target: float = 1.0,
    rng: Generator,
    level: float = LEVEL,
) -> Interval:
    """`aggregate` with an interval: runs are resampled within each environment.

    It is a claim about the method on these environments and episode seeds, over the training runs
    that might have been. The percentile interval that is usual here (rliable's) covers too little
    with few runs; this is a bootstrap-t interval, and for the median over environments, which
    jumps, a t-expanded percentile interval that asks for more runs.

    Args:
        scores: by environment; normalised.
        statistic: which.
        target: for the optimality gap.
        rng: draws the resamples.
        level: coverage, in [0.8, 0.99].
    Returns:
        `n` is the number of runs in all environments together.
    Raises:
        EvidenceError: fewer than `FEWEST_RUNS_TOGETHER` runs in all, or `FEWEST_RUNS_EACH` in an
            environment (one environment: `FEWEST_RUNS`; the median: `FEWEST_RUNS_FOR_MEDIANS` in
            each); or a figure isn't finite.
    Source: `stratified`; `expanded`.
    """
    where = "over_environments"
    check_level(level, where)
    strata = _strata(scores, statistic, where)
    value = _aggregate(strata, statistic, target)
    _enough_runs(strata, statistic)
    if statistic == "optimality_gap":
        strata = [target - np.minimum(each, target) for each in strata]
    runs = sum(map(len, strata))
    if len(strata) == 1:
        alone = "iqm" if statistic == "iqm" else "mean"
        return around(strata[0], statistic=alone, rng=rng, level=level)  # type: ignore[arg-type]
    if statistic == "median":
        freedom = min(map(len, strata)) - 1
        low, high = map(float, expanded(_resampled_medians(strata, rng), freedom, level))
        return Interval(value, low, high, runs, "t-expanded percentile, runs within environments")
    means = weighted_means([1 / len(strata)] * len(strata))
    result = stratified(strata, pooled_iqm if statistic == "iqm" else means, rng)
    least, most = result.bounds(level) if result.bounds else (0.0, 0.0)
    low, high = value - most * result.error, value - least * result.error
    return Interval(value, low, high, runs, "bootstrap-t, runs within environments")


def _strata(scores: Mapping[str, Scores], statistic: str, where: str) -> list[FloatArray]:
    if statistic not in AGGREGATES:
        raise EvidenceError(
            "there is no such statistic",
            where=where,
            expected=" or ".join(AGGREGATES),
            seen=repr(statistic),
        )
    enough(len(scores), 1, "environments", where=where)
    strata = [run_scores(each, where=f"{where}, {name}") for name, each in scores.items()]
    lengths = sorted({len(each) for each in strata})
    if statistic == "iqm" and len(lengths) > 1:
        raise EvidenceError(
            "environments would weigh differently in the interquartile mean",
            where=where,
            expected="the same number of training runs in each environment",
            seen=f"{lengths[0]} to {lengths[-1]}",
            mend="take the same number of runs, or statistic='mean'",
        )
    return strata


def _aggregate(strata: Sequence[FloatArray], statistic: Aggregate, target: float) -> float:
    if statistic == "iqm":
        return interquartile_mean(np.concatenate(strata))
    if statistic == "median":
        return float(np.median([each.mean() for each in strata]))
    if statistic == "optimality_gap":
        return float(target - np.mean([np.minimum(each, target).mean() for each in strata]))
    return float(np.mean([each.mean() for each in strata]))


def _enough_runs(strata: Sequence[FloatArray], statistic: Aggregate) -> None:
    where, least = "over_environments", min(map(len, strata))
    if len(strata) == 1:
        alone = FEWEST_RUNS["iqm" if statistic == "iqm" else "mean"]
        enough(least, alone, "training runs", where=where)
    elif statistic == "median":
        enough(least, FEWEST_RUNS_FOR_MEDIANS, "training runs in each environment", where=where)
    else:
        enough(least, FEWEST_RUNS_EACH, "training runs in each environment", where=where)
        runs = sum(map(len, strata))
        enough(runs, FEWEST_RUNS_TOGETHER, "training runs in all environments", where=where)


def _resampled_medians(strata: Sequence[FloatArray], rng: Generator) -> FloatArray:
    found = np.empty(RESAMPLES)
    step = max(CHUNK // sum(map(len, strata)), 1)
    for start in range(0, RESAMPLES, step):
        many = min(step, RESAMPLES - start)
        drawn = [each[rng.integers(0, len(each), (many, len(each)))] for each in strata]
        means = np.stack([each.mean(axis=1) for each in drawn])
        found[start : start + many] = np.median(means, axis=0)
    return found
