"""Claims about a method over several environments: aggregates of runs by environment."""

from collections.abc import Iterator, Mapping, Sequence
from math import inf, sqrt
from statistics import NormalDist
from typing import Final, Literal

import numpy as np
from numpy.random import Generator

from gamekeeper.errors import EvidenceError, check_choice
from gamekeeper.statistics.interval import (
    FEWEST_RUNS,
    FEWEST_RUNS_APART,
    FEWEST_RUNS_EACH,
    FEWEST_RUNS_FOR_MEDIANS,
    FEWEST_RUNS_TOGETHER,
    LEVEL,
    MANY_PAIRS,
    FloatArray,
    Interval,
    Statistic,
    check_level,
    enough,
    figures,
    no_spread,
)
from gamekeeper.statistics.one_sample import around
from gamekeeper.statistics.paired import exact_wins, tango
from gamekeeper.statistics.resampling import (
    CHUNK,
    RESAMPLES,
    expanded,
    interquartile_mean,
    pooled_iqm,
    stratified,
    weighted_means,
)
from gamekeeper.statistics.significance import wilson
from gamekeeper.statistics.student import boundary, hypotenuse, student
from gamekeeper.statistics.training_runs import (
    Crossed,
    Scores,
    crossed,
    run_scores,
    variance_of_seeds,
    with_seeds,
)

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
        target: the score that is good enough, for the optimality gap.
    Raises:
        EvidenceError: there is no environment, or for the iqm the numbers of runs differ.
    Source: Agarwal et al. 2021; rliable 1.2.0, metrics.py.
    """
    return _aggregate(_strata(scores, statistic, "aggregate"), statistic, target)


def profile(scores: Mapping[str, Scores], taus: Sequence[float]) -> dict[str, list[float]]:
    """Performance profile: the part of the runs whose score is above each of some values.

    Environments count alike, whatever their numbers of runs.

    Args:
        scores: by environment; normalised.
        taus: the values, ascending.
    Returns:
        `tau`, and `share` of the runs above it.
    Raises:
        EvidenceError: there is no environment, or a run without episodes.
    Source: Agarwal et al. 2021, 4.2; Dolan & More 2002, "Benchmarking optimization software with
        performance profiles".
    """
    strata = _strata(scores, "mean", "profile")
    share = [float(np.mean([(each > tau).mean() for each in strata])) for tau in taus]
    return {"tau": list(taus), "share": share}


def over_environments(
    scores: Mapping[str, Scores],
    *,
    statistic: Aggregate = "iqm",
    target: float = 1.0,
    shared_seeds: bool = True,
    rng: Generator,
    level: float = LEVEL,
) -> Interval:
    """`aggregate` with an interval: runs are resampled within each environment.

    It is a claim about the method on these environments, over the training runs and the episode
    seeds that might have been. The percentile interval that is usual here (rliable's) covers too
    little with few runs; this is a bootstrap-t interval, and for the median over environments,
    which jumps, a t-expanded percentile interval that asks for more runs.

    Args:
        scores: by environment; normalised.
        target: for the optimality gap.
        shared_seeds: column k of [runs, episodes] is the same episode seed in all runs of an
            environment; the luck of the seeds is then part of the interval.
        level: coverage, in [0.8, 0.99].
    Returns:
        `n` is the number of runs in all environments together.
    Raises:
        EvidenceError: fewer than `FEWEST_RUNS_TOGETHER` runs in all, or `FEWEST_RUNS_EACH` in an
            environment (one environment: `FEWEST_RUNS`; the median: `FEWEST_RUNS_FOR_MEDIANS` in
            each), or `FEWEST_SEEDS` shared seeds; a figure isn't finite, or nothing varies.
    Source: `stratified`; `expanded`; `with_seeds`.
    """
    where = "over_environments"
    check_level(level, where)
    strata = _strata(scores, statistic, where)
    value = _aggregate(strata, statistic, target)
    _enough_runs(strata, statistic)
    luck = [0.0] * len(strata)
    if shared_seeds:
        luck = list(_luck(list(scores.values()), strata, statistic, target))
    if statistic == "optimality_gap":
        # The gap is the mean of what each score lacks: from here on it is a mean like the other
        # one.
        strata = [target - np.minimum(each, target) for each in strata]
    runs = sum(map(len, strata))
    if statistic == "median" and len(strata) > 1:
        freedom = min(map(len, strata)) - 1
        low, high = map(float, expanded(_resampled_medians(strata, luck, rng), freedom, level))
        return Interval(value, low, high, runs, "t-expanded percentile, runs within environments")
    if len(strata) == 1:
        alone: Statistic = "iqm" if statistic == "iqm" else "mean"
        found = around(strata[0], statistic=alone, rng=rng, level=level, unit="training runs")
        freedom_of_runs = float(runs - 1)
    else:
        means = weighted_means([1 / len(strata)] * len(strata))
        result = stratified(strata, pooled_iqm if statistic == "iqm" else means, rng)
        if result.bounds is None:
            raise no_spread(value, runs, "training runs", where=where)
        least, most = result.bounds(level)
        # t is (estimate - truth) / error, so its greatest value bounds the truth from below.
        low, high = value - most * result.error, value - least * result.error
        found = Interval(value, low, high, runs, "bootstrap-t, runs within environments")
        freedom_of_runs = result.freedom
    if not any(luck):
        return found
    degrees = [1 if np.ndim(each[0]) == 0 else len(each[0]) - 1 for each in scores.values()]  # type: ignore[arg-type]  # rows
    # Satterthwaite: variances of environments add up, each known with its own degrees of freedom.
    freedom_of_seeds = sum(luck) ** 2 / sum(v * v / n for v, n in zip(luck, degrees, strict=True))
    reach = student(level, freedom_of_seeds) * sqrt(sum(luck))
    return with_seeds(found, reach, (freedom_of_runs, freedom_of_seeds), level)


def _luck(
    scores: Sequence[Scores], strata: Sequence[FloatArray], statistic: Aggregate, target: float
) -> Iterator[float]:
    """Variance of the estimate because of each environment's seeds.

    For the median over environments: of that environment's own mean.
    """
    where, many = "over_environments", len(strata)
    ordered = np.sort(np.concatenate(strata))
    cut = len(ordered) // 4
    low, high = ordered[cut], ordered[len(ordered) - cut - 1]
    middle = int(((ordered >= low) & (ordered <= high)).sum())
    for each, means in zip(scores, strata, strict=True):
        matrix = crossed(each, where=where)
        kept, weight = np.arange(len(means)), 1.0 if statistic == "median" else 1 / many
        if statistic == "iqm":
            # To first order only runs between the quartiles move the interquartile mean.
            kept = np.flatnonzero((means >= low) & (means <= high))
            weight = len(kept) / middle
        elif statistic == "optimality_gap":
            # A run above the target lacks nothing, whatever its seeds.
            kept = np.flatnonzero(means < target)
            weight = len(kept) / len(means) / many
        if matrix is None or not len(kept):
            yield 0.0
        else:
            yield variance_of_seeds([Crossed(matrix, kept, weight)], where=where)


def _strata(scores: Mapping[str, Scores], statistic: str, where: str) -> list[FloatArray]:
    what = "there is no such statistic"
    check_choice(statistic, AGGREGATES, what, where=where, error=EvidenceError)
    enough(len(scores), 1, "environments", where=where)
    strata = [run_scores(each, where=f"{where}, {name}") for name, each in scores.items()]
    lengths = sorted({len(each) for each in strata})
    if statistic == "iqm" and len(lengths) > 1:
        raise EvidenceError(
            "environments would weigh differently in the interquartile mean",
            where=where,
            expected="the same number of training runs in each environment",
            actual=f"{lengths[0]} to {lengths[-1]}",
            fix="take the same number of runs, or statistic='mean'",
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


def _resampled_medians(
    strata: Sequence[FloatArray], luck: Sequence[float], rng: Generator
) -> FloatArray:
    found = np.empty(RESAMPLES)
    step = max(CHUNK // sum(map(len, strata)), 1)
    for start in range(0, RESAMPLES, step):
        many = min(step, RESAMPLES - start)
        drawn = [each[rng.integers(0, len(each), (many, len(each)))] for each in strata]
        means = np.stack([each.mean(axis=1) for each in drawn])
        if any(luck):
            # Seeds move all runs of an environment at once: they are added to its mean, not to a
            # run.
            means += np.sqrt(luck)[:, None] * rng.standard_normal(means.shape)
        found[start : start + many] = np.median(means, axis=0)
    return found


Figures = Sequence[float] | FloatArray
_WHERE = "improvement"


def probability_of_improvement(a: Figures, b: Figures) -> float:
    """The chance that a value of `a` is above one of `b`, ties counting half (Mann-Whitney).

    Args:
        a: [n].
        b: [m].
    Raises:
        EvidenceError: one has no values, or a value isn't finite.
    Source: Agarwal et al. 2021; Mann & Whitney 1947.
    """
    one, two = figures(a, _WHERE), np.sort(figures(b, _WHERE))
    enough(min(len(one), len(two)), 1, "values", where=_WHERE)
    # A value of b below counts twice, a tied one once; hence half of the sum.
    under = np.searchsorted(two, one, side="left") + np.searchsorted(two, one, side="right")
    return float(under.sum() / (2 * len(one) * len(two)))


def improvement(
    a: Figures | Mapping[str, Figures],
    b: Figures | Mapping[str, Figures],
    *,
    paired: bool,
    level: float = LEVEL,
) -> Interval:
    """The probability that `a` beats `b`, ties counting half, with an interval.

    Not paired: Newcombe's interval for the Mann-Whitney statistic, its variance less by what ties
    take from it; where only two values occur, Wilson's intervals of both shares. Paired: Tango's
    score interval of wins less losses; of fewer than 50 pairs exact intervals of both shares. Over
    several environments the distances are put together, and Newcombe's reach by Student's quantile,
    without which they cover too little.

    Args:
        a: [n] scores of runs (not paired), or figures of episodes on shared seeds (paired); or such
            by environment, and then the mean over environments, as in rliable.
        b: of the other; equally many where paired.
        paired: value k of `a` meets value k of `b` alone.
        level: coverage, in [0.8, 0.99].
    Returns:
        `n` is the number of pairs, or the smaller number of values, in the least environment.
    Raises:
        EvidenceError: fewer than 10 values that aren't paired, different environments, or pairs
            that don't match.
    Source: Newcombe 2006, "Confidence intervals for an effect size measure based on the
        Mann-Whitney statistic, part 2", method 5; Newcombe 1998, method 10; Tango 1998; Zou &
        Donner 2008 (MOVER).
    """
    check_level(level, _WHERE)
    ones, twos = _by_environment(a), _by_environment(b)
    if list(ones) != list(twos) and set(ones) != set(twos):
        raise EvidenceError(
            "two methods played different environments",
            where=_WHERE,
            expected=", ".join(ones),
            actual=", ".join(twos),
            fix="compare methods over the same environments",
        )
    many = len(ones)
    if paired:
        found = [_paired(ones[name], twos[name], level) for name in ones]
    else:
        found = [_independent(ones[name], twos[name], level, many > 1) for name in ones]
    value = sum(each.value for each in found) / many
    low = value - hypotenuse(*(each.value - each.low for each in found)) / many
    high = value + hypotenuse(*(each.high - each.value for each in found)) / many
    return Interval(value, low, high, min(each.n for each in found), found[0].method)


def _by_environment(values: Figures | Mapping[str, Figures]) -> dict[str, FloatArray]:
    if not isinstance(values, Mapping):
        return {"": figures(values, _WHERE)}
    enough(len(values), 1, "environments", where=_WHERE)
    return {name: figures(each, f"{_WHERE}, {name}") for name, each in values.items()}


def _paired(a: FloatArray, b: FloatArray, level: float) -> Interval:
    if a.shape != b.shape:
        raise EvidenceError(
            "values can't be paired",
            where=_WHERE,
            expected="equally many, on the same seeds",
            actual=f"{len(a)} and {len(b)}",
            fix="pair values of the same seeds in the same order",
        )
    n, wins, losses = len(a), int((a > b).sum()), int((a < b).sum())
    enough(n, 1, "pairs", where=_WHERE)
    value = 0.5 + (wins - losses) / n / 2
    if n < MANY_PAIRS:
        return Interval(value, *exact_wins(wins, losses, n, level), n, "Clopper-Pearson")
    low, high = tango(wins, losses, n, level)
    return Interval(value, 0.5 + low / 2, 0.5 + high / 2, n, "Tango, of wins less losses")


def _independent(a: FloatArray, b: FloatArray, level: float, is_one_of_many: bool) -> Interval:
    """One environment; of many the normal quantile gives too little, by simulation."""
    n = min(len(a), len(b))
    enough(n, FEWEST_RUNS_APART, "values of each", where=_WHERE)
    value = probability_of_improvement(a, b)
    seen, counts = np.unique(np.concatenate([a, b]), return_counts=True)
    if len(seen) <= 2:
        one, two = (
            wilson(int((each == seen[-1]).sum()), len(each), level=level) for each in (a, b)
        )
        # With two values the chance is 1/2 + (share of a - share of b) / 2, so half of the
        # distances.
        low = value - hypotenuse(one.p - one.low, two.high - two.p) / 2
        high = value + hypotenuse(one.high - one.p, two.p - two.low) / 2
        return Interval(value, low, high, n, "Newcombe, of two shares")
    both = len(a) + len(b)
    # c values that are tied take c^3 - c from the N^3 - N of the variance of a sum of ranks.
    untied = 1 - float((counts**3.0 - counts).sum()) / (both**3 - both)
    z = student(level, both - 2) if is_one_of_many else NormalDist().inv_cdf(0.5 + level / 2)
    low, high = _newcombe(value, len(a), len(b), untied, z)
    return Interval(value, low, high, n, "Newcombe, of Mann-Whitney")


def _newcombe(value: float, n: int, m: int, untied: float, z: float) -> tuple[float, float]:
    """The chances that a score test with the exponential model's variance doesn't reject."""
    # Hanley & McNeil 1982, with the mean of n - 1 and m - 1 in place of each (this is method 5).
    half = (n + m) / 2 - 1

    def score(truth: float) -> float:
        spread = half * ((1 - truth) / (2 - truth) + truth / (1 + truth))
        variance = truth * (1 - truth) * (1 + spread) / (n * m) * untied
        off = value - truth
        if variance <= 0:
            return 0.0 if off == 0 else inf * off
        return off / sqrt(variance)

    low = 0.0 if value <= 0 else boundary(lambda truth: score(truth) > z, 0.0, value)
    high = 1.0 if value >= 1 else boundary(lambda truth: score(truth) > -z, value, 1.0)
    return low, high
