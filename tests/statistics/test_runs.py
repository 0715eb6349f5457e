"""Intervals over training runs: laws, shared seeds, coverage, refusals."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.training_runs import (
    difference_over_runs,
    over_runs,
    rests_on_few,
    run_scores,
)

SCORES = st.lists(st.integers(-50, 50), min_size=30, max_size=36).filter(lambda x: len(set(x)) > 3)


def _over(scores, *, statistic="mean", shared=True, seed=0):
    rng = np.random.default_rng(seed)
    return over_runs(scores, statistic=statistic, shared_seeds=shared, rng=rng)


def _apart(a, b, *, shared=True, seed=0):
    rng = np.random.default_rng(seed)
    return difference_over_runs(a, b, shared_seeds=shared, rng=rng)


def test_run_scores_are_means_over_episodes() -> None:
    """Scores come as numbers, as a table, or as runs of different lengths."""
    assert list(run_scores([1, 2])) == [1.0, 2.0]
    assert list(run_scores(np.array([[1.0, 2.0], [3.0, 4.0]]))) == [1.5, 3.5]
    assert list(run_scores([[1.0, 2.0, 3.0], [5.0]])) == [2.0, 5.0]


@pytest.mark.parametrize("scores", [[], [[1.0], []], [[1.0], [np.inf]]])
def test_run_scores_refuse_runs_without_any(scores) -> None:
    """No runs, a run without episodes and a score that isn't finite are refused."""
    with pytest.raises(EvidenceError, match="run_scores"):
        run_scores(scores)


@settings(max_examples=15, deadline=None)
@given(SCORES, st.sampled_from(["mean", "iqm", "median"]), st.sampled_from([0.5, 40.0]))
def test_over_runs_holds_its_value_in_other_units(scores, statistic, unit) -> None:
    """The estimate is inside its interval, which follows units."""
    one = _over(np.array(scores, float), statistic=statistic)
    two = _over(unit * np.array(scores, float) + 3, statistic=statistic)
    assert one.low <= one.value <= one.high
    expected = [unit * each + 3 for each in (one.low, one.value, one.high)]
    assert expected == pytest.approx([two.low, two.value, two.high], abs=1e-6)


@pytest.mark.parametrize(("statistic", "fewest"), [("mean", 30), ("iqm", 12), ("median", 10)])
def test_over_runs_is_refused_below_its_number(statistic, fewest) -> None:
    """One run less is listed, not summed up; thousands of episodes don't stand in for runs."""
    scores = np.random.default_rng(0).normal(size=(fewest, 1000))
    assert fewest == _over(scores, statistic=statistic).n
    with pytest.raises(EvidenceError, match="too few training runs") as caught:
        _over(scores[1:], statistic=statistic)
    assert f"at least {fewest} training runs" in str(caught.value)
    assert f"actual: {fewest - 1}" in str(caught.value)


def test_over_runs_counts_the_luck_of_shared_seeds() -> None:
    """Runs that are all alike on shared seeds are unsure; on seeds of their own they aren't."""
    rng = np.random.default_rng(3)
    scores = rng.normal(size=40) + rng.normal(0, 0.01, (30, 40))
    shared, own = _over(scores), _over(scores, shared=False)
    assert own.high - own.low < 0.02
    assert 0.4 < shared.high - shared.low < 1.0
    assert "shared seeds" in shared.method


def test_over_runs_of_independent_episodes_adds_next_to_nothing() -> None:
    """Where columns have nothing in common, the interval is that over runs alone."""
    widths = []
    for seed in range(20):
        scores = np.random.default_rng(seed).normal(size=(30, 50))
        shared, own = _over(scores), _over(scores, shared=False)
        widths.append((shared.high - shared.low) / (own.high - own.low))
    assert 1.0 <= np.median(widths) < 1.1


@pytest.mark.parametrize("scores", [[[1.0] * 12] * 29 + [[2.0] * 11], np.eye(30)[:, :9]])
def test_over_runs_refuses_seeds_that_it_cant_judge(scores) -> None:
    """Ragged runs share no seeds; nine shared seeds don't show their luck; told not to, it does."""
    with pytest.raises(EvidenceError, match="seeds"):
        _over(scores)
    means = [np.mean(row) for row in scores]
    assert _over(scores, shared=False).value == pytest.approx(np.mean(means))


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("apart", [0.0, 0.3, 2.0])
def test_over_runs_covers_as_it_says(apart, shared) -> None:
    """Near 95 of 100 intervals hold the truth, however far runs lie apart."""
    held = 0
    for repeat in range(150):
        rng = np.random.default_rng(repeat)
        seeds = rng.normal(0, 0.7, 30) if shared else np.zeros(30)
        scores = rng.normal(0, apart, (30, 1)) + seeds + rng.normal(0, 0.7, (30, 30))
        found = over_runs(scores, shared_seeds=shared, rng=rng)
        held += found.low <= 0 <= found.high
    assert 135 <= held <= 149


@settings(max_examples=15, deadline=None)
@given(SCORES, SCORES)
def test_difference_over_runs_changes_sides(a, b) -> None:
    """The other way round the difference has the other sign; its p says what the interval says."""
    assume(not rests_on_few(np.array(a), np.array(b)))
    one, two = _apart(a, b), _apart(b, a)
    assert np.mean(b) - np.mean(a) == pytest.approx(one.value)
    assert one.value == pytest.approx(-two.value)
    assert one.low <= one.value <= one.high
    if abs(one.p - 0.05) > 1e-6:
        assert (one.p < 0.05) == (not one.low <= 0 <= one.high)


def test_difference_over_runs_follows_shared_seeds() -> None:
    """What a lucky seed gives both methods cancels; what it gives one of them doesn't."""
    rng = np.random.default_rng(1)
    seeds, noise = 5 * rng.normal(size=30), rng.normal(0, 0.1, (2, 10, 30))
    alike = _apart(seeds + noise[0], seeds + noise[1] + 1)
    other = _apart(seeds + noise[0], rng.normal(size=30) + noise[1] + 1)
    assert alike.high - alike.low < 0.1
    assert other.high - other.low > 1.0
    assert alike.p < 0.001 < other.p


@pytest.mark.parametrize("other", [2.0, 3.0])
def test_difference_over_runs_of_equal_runs_is_refused(other) -> None:
    """Where nothing varies, nothing is known of the spread."""
    with pytest.raises(EvidenceError, match="nothing is known of its spread"):
        _apart([2.0] * 10, [other] * 12)


def test_difference_over_runs_that_hangs_on_a_few_is_refused() -> None:
    """Where runs are alike but for two, unless methods are apart all the same."""
    rng = np.random.default_rng(0)
    alike = rng.normal(0, 0.01, (2, 20))
    alike[0, :2] = 1.0, -1.5
    with pytest.raises(EvidenceError, match="a few that carry all of the spread"):
        _apart(*alike)
    assert _apart(alike[0], alike[1] + 3).low > 2.5
    for ordinary in (rng.normal(size=(2, 20)), rng.exponential(size=(2, 20))):
        assert not rests_on_few(*ordinary)


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (np.ones(9), np.ones(20), "too few training runs"),
        (np.ones((10, 12)), np.ones((10, 13)), "same seeds"),
    ],
)
def test_difference_over_runs_refuses(a, b, message) -> None:
    """Too few runs of one method, and methods on different seeds, are refused."""
    with pytest.raises(EvidenceError, match=message):
        _apart(a, b)
