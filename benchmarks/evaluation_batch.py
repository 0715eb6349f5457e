"""The intervals of evaluation for many experiments at once, to simulate their coverage.

The bounds are the package's own (`reach_of_mean`, `reach`, `expanded`, `quantile`'s ranks); only
the resampling is done for all experiments by one matrix of counts. `same()` holds each of them
against the package's function on the same resamples. `evaluation_coverage.py` calls it first.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.random import Generator

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.aggregates import over_environments
from gamekeeper.statistics.interval import Statistic
from gamekeeper.statistics.one_sample import (
    LEAST_DISTINCT,
    around,
    differing,
    quantile,
    ranks,
    reach_of_mean,
)
from gamekeeper.statistics.resampling import expanded, interquartile_mean, reach
from gamekeeper.statistics.student import hypotenuse
from gamekeeper.statistics.training_runs import (
    Crossed,
    difference_over_runs,
    kept_runs,
    reach_of_seeds,
    rests_on_few,
    too_long,
)
from gamekeeper.statistics.training_runs import over_runs as method

RESAMPLES = 999
"""In place of the package's 4,999."""
Bounds = tuple[Any, Any]
POINT = {"mean": np.mean, "iqm": interquartile_mean, "median": np.median}


def counts(n: int, rng: Generator, resamples: int = RESAMPLES) -> Any:
    """[resamples, n] how often each place is drawn, by the numbers that the package draws."""
    drawn = rng.integers(0, n, (resamples, n)) + n * np.arange(resamples)[:, None]
    return np.bincount(drawn.ravel(), minlength=resamples * n).reshape(resamples, n) * 1.0


def middle_weights(drawn: Any) -> Any:
    """[resamples, n] weights of sorted values in each resample's interquartile mean."""
    n = drawn.shape[1]
    cut = n // 4
    upto = np.cumsum(drawn, axis=1)
    kept = np.clip(upto, cut, n - cut) - np.clip(upto - drawn, cut, n - cut)
    return kept / (n - 2 * cut)


def resampled(values: Any, drawn: Any, statistic: str) -> Any:
    """[experiments, resamples] of a statistic."""
    if statistic == "mean":
        return values @ drawn.T / values.shape[1]
    ordered = np.sort(values, axis=1)
    if statistic == "iqm":
        return ordered @ middle_weights(drawn).T
    upto = np.cumsum(drawn, axis=1)
    places = [(upto <= place).sum(axis=1) for place in ((len(upto[0]) - 1) // 2, len(upto[0]) // 2)]
    return (ordered[:, places[0]] + ordered[:, places[1]]) / 2


def one_sample(values: Any, statistic: Statistic, drawn: Any) -> Bounds:
    """The bounds of `around` for each row.

    Args:
        values: [experiments, n].
        statistic: which.
        drawn: [resamples, n] counts.
    """
    if statistic == "median":
        return quantiles(values, 0.5)
    n = values.shape[1]
    if statistic == "iqm":
        low, high = expanded(resampled(values, drawn, "iqm"), n - 1, 0.95)
        middle = np.sort(values, axis=1)[:, n // 4 : n - n // 4].mean(axis=1)
        low, high = np.minimum(low, middle), np.maximum(high, middle)
        heaped = high - low <= 1e-12 * np.abs(values).max(axis=1)
        low[heaped] = high[heaped] = np.nan
    else:
        low, high = means(values, drawn)
    ends = (values == values.min(axis=1)[:, None]) | (values == values.max(axis=1)[:, None])
    for row in np.flatnonzero(ends.all(axis=1)):
        try:
            found = around(
                values[row], statistic=statistic, rng=np.random.default_rng(0), level=0.95
            )
        except EvidenceError:  # refused
            low[row] = high[row] = np.nan
        else:
            low[row], high[row] = found.low, found.high
    return low, high


def means(values: Any, drawn: Any) -> Bounds:
    """Bootstrap-t bounds of means."""
    n = values.shape[1]
    centre, spread = values.mean(axis=1), values.std(axis=1, ddof=1)
    standard = (values - centre[:, None]) / np.where(spread > 0, spread, 1.0)[:, None]
    mean = standard @ drawn.T / n
    variance = (standard * standard) @ drawn.T / n - mean * mean
    t = mean * np.sqrt(n - 1) / np.sqrt(np.maximum(variance, 1e-12))
    least, most = reach_of_mean(t, standard, 0.95)
    error = spread / np.sqrt(n)
    return centre - most * error, centre - least * error


def quantiles(values: Any, part: float) -> Bounds:
    """The bounds of `quantile` for each row."""
    ordered = np.sort(values, axis=1)
    refused = differing(ordered, part, 0.025) < LEAST_DISTINCT
    low = _between(ordered, ranks(values.shape[1], part, 0.025))
    high = -_between(-ordered[:, ::-1], ranks(values.shape[1], 1 - part, 0.025))
    value = np.quantile(ordered, part, axis=1)
    low, high = np.minimum(low, value), np.maximum(high, value)
    return np.where(refused, np.nan, low), np.where(refused, np.nan, high)


def _between(ordered: Any, where: tuple[int, float]) -> Any:
    under, weight = where
    return (1 - weight) * ordered[:, under - 1] + weight * ordered[:, under]


def environment_means(strata: Sequence[Any], drawn: Sequence[Any]) -> Bounds:
    """The bounds of `over_environments`' mean for each experiment.

    Args:
        strata: of each environment [experiments, runs].
        drawn: of each [resamples, runs] counts.
    """
    return weighted_means(strata, drawn, [1 / len(strata)] * len(strata))


def weighted_means(strata: Sequence[Any], drawn: Sequence[Any], parts: Sequence[float]) -> Bounds:
    """The bounds of a weighted sum of means."""
    value, spread, terms = 0.0, 0.0, 0.0
    made, width = 0.0, 0.0
    for each, weights, part in zip(strata, drawn, parts, strict=True):
        n = each.shape[1]
        variance = each.var(axis=1, ddof=1) / n * part**2
        value, spread = value + each.mean(axis=1) * part, spread + variance
        terms = terms + variance**2 / (n - 1)
        centre = each.mean(axis=1)[:, None]
        off = each - centre
        mean = off @ weights.T / n
        squares = (off * off) @ weights.T / n - mean * mean
        made = made + mean * part
        width = width + squares / (n - 1) * part**2
    t = made / np.sqrt(np.maximum(width, 1e-12 * spread[:, None]))
    low, high = np.empty(len(t)), np.empty(len(t))
    for row, each in enumerate(t):
        least, most = reach(each, spread[row] ** 2 / terms[row])(0.95)
        error = spread[row] ** 0.5
        low[row], high[row] = value[row] - most * error, value[row] - least * error
    return low, high


def differences(a: Any, b: Any, drawn: Sequence[Any]) -> Bounds:
    """The bounds of `difference_over_runs` for each experiment; NaN where it is refused."""
    low, high = weighted_means([a, b], drawn, [-1.0, 1.0])
    refused = rests_on_few(a, b)
    return np.where(refused, np.nan, low), np.where(refused, np.nan, high)


def environment_medians(strata: Sequence[Any], drawn: Sequence[Any]) -> Bounds:
    """The bounds of `over_environments`' median for each experiment."""
    found = np.stack([resampled(*pair, "mean") for pair in zip(strata, drawn, strict=True)])
    freedom = min(each.shape[1] for each in strata) - 1
    return expanded(np.median(found, axis=0), freedom, 0.95)


def over_runs(scores_re: Any, statistic: Statistic, drawn: Any) -> Bounds:
    """The bounds of `over_runs` on shared seeds for each experiment.

    Args:
        scores_re: [experiments, runs, episodes].
        statistic: of runs' scores.
        drawn: [resamples, runs] counts.
    """
    means_r = scores_re.mean(axis=2)
    low, high = one_sample(means_r, statistic, drawn)
    runs, episodes = scores_re.shape[1:]
    for row, scores in enumerate(scores_re):
        block = Crossed(scores, kept_runs(means_r[row], statistic), 1.0)
        seeds = reach_of_seeds([block], where="benchmark")(0.95)
        part = too_long((high[row] - low[row]) / 2, seeds, (runs - 1, episodes - 1), 0.95)
        value = POINT[statistic](means_r[row])
        low[row] = value - part * hypotenuse(value - low[row], seeds)
        high[row] = value + part * hypotenuse(high[row] - value, seeds)
    return low, high


def same() -> None:
    """Each is the package's on the same resamples.

    Raises:
        AssertionError: one isn't.
    """
    values = np.sort(np.random.default_rng(3).exponential(size=(4, 30)))
    for statistic in ("mean", "iqm", "median"):
        low, high = one_sample(values, statistic, counts(30, np.random.default_rng(1)))
        for row, each in enumerate(values):
            rng = np.random.default_rng(1)
            found = around(each, statistic=statistic, rng=rng, level=0.95)
            np.testing.assert_allclose((low[row], high[row]), (found.low, found.high), atol=1e-9)
        scores = values[:, :, None] + np.random.default_rng(5).normal(size=(4, 30, 12))
        scores = scores[:, np.argsort(scores.mean(axis=2)[0])]
        low, high = over_runs(scores, statistic, counts(30, np.random.default_rng(1)))
        found = method(scores[0], statistic=statistic, rng=np.random.default_rng(1))
        np.testing.assert_allclose((low[0], high[0]), (found.low, found.high), atol=1e-9)
    rng = np.random.default_rng(1)
    low, high = differences(values, 2 * values[::-1], [counts(30, rng), counts(30, rng)])
    effect = difference_over_runs(values[0], 2 * values[-1], rng=np.random.default_rng(1))
    np.testing.assert_allclose((low[0], high[0]), (effect.low, effect.high), atol=1e-9)
    low, high = quantiles(values, 0.25)
    found = quantile(values[0], 0.25)
    np.testing.assert_allclose((low[0], high[0]), (found.low, found.high))
    strata = [values, values[::-1] ** 2]
    for statistic, batch in (("mean", environment_means), ("median", environment_medians)):
        rng = np.random.default_rng(1)
        low, high = batch(strata, [counts(30, rng), counts(30, rng)])
        scores = {str(k): each[0] for k, each in enumerate(strata)}
        rng = np.random.default_rng(1)
        found = over_environments(scores, statistic=statistic, rng=rng)
        np.testing.assert_allclose((low[0], high[0]), (found.low, found.high), atol=1e-9)
