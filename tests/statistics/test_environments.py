"""Aggregates over environments: known figures, laws, coverage, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.aggregates import AGGREGATES, aggregate, over_environments
from gamekeeper.statistics.training_runs import over_runs


def _over(scores, *, statistic, seed=0):
    return over_environments(scores, statistic=statistic, rng=np.random.default_rng(seed))


def _scores(runs, environments=3, seed=0):
    rng = np.random.default_rng(seed)
    return {f"env{k}": rng.normal(0.3 * k, 0.3, runs) for k in range(environments)}


def test_aggregate_gives_known_figures() -> None:
    """The four aggregates of a small table, by hand; of rows the means over episodes count."""
    scores = {"a": [0.0, 1.0], "b": [0.5, 2.5], "c": [[3.0, 5.0], [4.0, 8.0]]}
    assert pytest.approx((0.5 + 1.5 + 5.0) / 3) == aggregate(scores, statistic="mean")
    assert pytest.approx(1.5) == aggregate(scores, statistic="median")
    assert pytest.approx((0.5 + 1 + 2.5 + 4) / 4) == aggregate(scores, statistic="iqm")
    assert pytest.approx(1.5 / 6) == aggregate(scores, statistic="optimality_gap")
    assert pytest.approx(3 - 10.0 / 6) == aggregate(scores, statistic="optimality_gap", target=3)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 99), st.sampled_from(AGGREGATES), st.integers(2, 5))
def test_over_environments_holds_its_value(seed, statistic, environments) -> None:
    """The estimate is inside its interval and is the aggregate, in any order of environments."""
    scores = _scores(30, environments, seed)
    found = _over(scores, statistic=statistic)
    assert aggregate(scores, statistic=statistic) == pytest.approx(found.value)
    assert found.low <= found.value <= found.high
    assert 30 * environments == found.n
    mixed = dict(reversed(scores.items()))
    assert found.value == pytest.approx(aggregate(mixed, statistic=statistic))


def test_over_environments_of_one_is_over_runs() -> None:
    """A single environment is what a method's runs there say."""
    scores = _scores(12, 1)
    one = _over(scores, statistic="iqm")
    two = over_runs(scores["env0"], statistic="iqm", rng=np.random.default_rng(0))
    assert (one.low, one.value, one.high) == (two.low, two.value, two.high)


def test_over_environments_of_equal_scores_is_refused() -> None:
    """Where nothing varies, nothing is known of the spread."""
    with pytest.raises(EvidenceError, match="nothing is known of its spread"):
        _over({name: [0.4] * 10 for name in "abc"}, statistic="mean")


@pytest.mark.parametrize("statistic", ["mean", "iqm", "optimality_gap"])
def test_over_environments_holds_the_luck_of_seeds(statistic) -> None:
    """Runs that are alike on ten shared seeds are wider than on seeds of their own."""
    rng = np.random.default_rng(0)
    scores = {name: 0.1 * rng.normal(size=(12, 1)) + rng.normal(size=10) for name in "abc"}
    wide, narrow = (
        over_environments(
            scores,
            statistic=statistic,
            target=3.0,
            shared_seeds=shared,
            rng=np.random.default_rng(1),
        )
        for shared in (True, False)
    )
    assert wide.high - wide.low > 3 * (narrow.high - narrow.low)


@pytest.mark.parametrize(
    ("runs", "environments", "statistic", "fewest"),
    [
        (11, 1, "iqm", "at least 12"),
        (29, 1, "mean", "at least 30"),
        (9, 3, "iqm", "at least 30 training runs in all"),
        (2, 40, "mean", "at least 3 training runs in each"),
        (29, 5, "median", "at least 30 training runs in each"),
    ],
)
def test_over_environments_is_refused_below_its_number(
    runs, environments, statistic, fewest
) -> None:
    """Few runs are refused by their number together and in each environment."""
    with pytest.raises(EvidenceError, match=fewest):
        _over(_scores(runs, environments), statistic=statistic)


@pytest.mark.parametrize(
    ("scores", "statistic", "message"),
    [
        ({}, "mean", "environments"),
        ({"a": [1.0, 2.0], "b": [1.0]}, "iqm", "weigh differently"),
        ({"a": [1.0]}, "mode", "no such statistic"),
    ],
)
def test_aggregate_refuses(scores, statistic, message) -> None:
    """No environments, unequal weights in the interquartile mean and unknown statistics."""
    with pytest.raises(EvidenceError, match=message):
        aggregate(scores, statistic=statistic)


@pytest.mark.parametrize("statistic", ["mean", "iqm", "optimality_gap"])
def test_over_environments_covers_as_it_says(statistic) -> None:
    """With 3 runs in each of 10 environments near 95 of 100 intervals hold the truth."""
    big = _scores(200_000, 10, seed=99)
    truth = aggregate(big, statistic=statistic)
    found = [_over(_scores(3, 10, seed), statistic=statistic, seed=seed) for seed in range(60)]
    assert sum(each.low <= truth <= each.high for each in found) >= 52
