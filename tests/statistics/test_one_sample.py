"""Intervals over the episodes of one checkpoint: laws, exact cases, coverage, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.interval import FEWEST_EPISODES
from gamekeeper.statistics.one_sample import fewest_for_quantile, one_sample, quantile
from gamekeeper.statistics.resampling import interquartile_mean
from gamekeeper.statistics.significance import wilson

STATISTICS = ["mean", "iqm", "median"]
VALUES = st.lists(st.integers(-999, 999), min_size=100, max_size=110, unique=True)


def _interval(values, *, statistic="mean", seed=0, level=0.95):
    rng = np.random.default_rng(seed)
    return one_sample(np.asarray(values, float), statistic=statistic, rng=rng, level=level)


@given(st.lists(st.integers(-20, 20), min_size=1, max_size=40), st.randoms(use_true_random=False))
def test_interquartile_mean_is_between_the_quartiles(values, random) -> None:
    """It is the mean of the middle, in whatever order the values come."""
    mixed = list(values)
    random.shuffle(mixed)
    cut = len(values) // 4
    kept = sorted(values)[cut : len(values) - cut]
    assert pytest.approx(np.mean(kept)) == interquartile_mean(mixed)
    assert kept[0] - 1e-9 <= interquartile_mean(values) <= kept[-1] + 1e-9


@pytest.mark.parametrize("values", [[], [[1.0, 2.0]], [1.0, np.nan]])
def test_interquartile_mean_refuses_what_has_none(values) -> None:
    """No values, tables and values that aren't numbers are refused."""
    with pytest.raises(EvidenceError, match="interquartile_mean"):
        interquartile_mean(values)


@settings(max_examples=15, deadline=None)
@given(VALUES, st.sampled_from(STATISTICS))
def test_one_sample_holds_its_value(values, statistic) -> None:
    """The estimate is inside its interval, and both are among the values."""
    values = [*values, 1007, -1008]
    found = _interval(values, statistic=statistic)
    assert found.low - 1e-9 <= found.value <= found.high + 1e-9
    assert len(values) == found.n


@settings(max_examples=15, deadline=None)
@given(VALUES, st.sampled_from(STATISTICS), st.sampled_from([0.5, 3.0, 100.0]), st.integers(-9, 9))
def test_one_sample_follows_shift_and_scale(values, statistic, scale, shift) -> None:
    """Other units and another zero move the interval by as much."""
    values = np.array([*values, 1007.0, -1008.0])
    one = _interval(values, statistic=statistic)
    two = _interval(scale * values + shift, statistic=statistic)
    expected = [scale * each + shift for each in (one.low, one.value, one.high)]
    assert expected == pytest.approx([two.low, two.value, two.high], abs=1e-6)


@settings(max_examples=10, deadline=None)
@given(VALUES, st.sampled_from(STATISTICS), st.randoms(use_true_random=False))
def test_one_sample_bears_another_order(values, statistic, random) -> None:
    """The order of the values changes nothing but the resamples' luck."""
    values = [*values, *range(2000, 2019)]
    mixed = list(values)
    random.shuffle(mixed)
    one, two = _interval(values, statistic=statistic), _interval(mixed, statistic=statistic)
    assert one.value == pytest.approx(two.value)
    slack = 0.15 * (one.high - one.low)
    assert [one.low, one.high] == pytest.approx([two.low, two.high], abs=slack)


def test_one_sample_of_success_is_wilson() -> None:
    """Two outcomes, whatever they are, have the interval of their share."""
    share = wilson(40, 60)
    one, two = _interval([1] * 40 + [0] * 20), _interval([5] * 40 + [-5] * 20)
    assert (share.p, share.low, share.high) == (one.value, one.low, one.high)
    assert (10 * share.low - 5, 10 * share.high - 5) == pytest.approx((two.low, two.high))


def test_one_sample_of_nothing_but_success_is_still_unsure() -> None:
    """Fifty successes don't show that there is no failure."""
    rng = np.random.default_rng(0)
    found = one_sample(np.ones(50), rng=rng, is_share=True)
    assert found.low == pytest.approx(wilson(50, 50).low)


@pytest.mark.parametrize("statistic", STATISTICS)
@pytest.mark.parametrize("value", [0.0, 1.0, 10.0, 2.5])
def test_one_sample_of_equal_returns_is_refused_in_any_unit(statistic, value) -> None:
    """They say nothing of their spread; what they may have missed is said."""
    with pytest.raises(EvidenceError, match="all 50 episodes have the same") as caught:
        _interval([value] * 50, statistic=statistic)
    assert "values rarer than 1 in 16 may be missing" in str(caught.value)


@pytest.mark.parametrize("statistic", STATISTICS)
def test_one_sample_is_refused_below_its_number(statistic) -> None:
    """With one episode less than it asks for there is no interval, and the error says how many."""
    fewest = FEWEST_EPISODES[statistic]
    assert _interval(np.arange(fewest), statistic=statistic).n == fewest
    with pytest.raises(EvidenceError, match="too few episodes") as caught:
        _interval(np.arange(fewest - 1), statistic=statistic)
    assert f"at least {fewest} episodes" in str(caught.value)


@pytest.mark.parametrize(
    ("message", "options"),
    [("no interval of this level", {"level": 0.5}), ("no such statistic", {"statistic": "mode"})],
)
def test_one_sample_refuses_other_questions(message, options) -> None:
    """A level that wasn't simulated and a statistic that isn't there are refused."""
    with pytest.raises(EvidenceError, match=message):
        _interval(np.arange(95), **options)


@pytest.mark.parametrize("statistic", STATISTICS)
@pytest.mark.parametrize("name", ["normal", "exponential"])
def test_one_sample_covers_as_it_says(name, statistic) -> None:
    """With as few episodes as it asks for, near 95 of 100 intervals hold the truth."""
    n = FEWEST_EPISODES[statistic]
    truths = {"normal": 0.0, "mean": 1.0, "iqm": 0.7387, "median": np.log(2)}
    truth = truths["normal" if name == "normal" else statistic]
    held = 0
    for repeat in range(150):
        rng = np.random.default_rng([repeat, n])
        values = rng.normal(size=n) if name == "normal" else rng.exponential(size=n)
        found = one_sample(values, statistic=statistic, rng=rng)
        held += found.low <= truth <= found.high
    assert 135 <= held <= 149


def test_quantile_interval_is_published() -> None:
    """The median of 10 has its interval between the second and third from either end."""
    found = quantile(np.arange(1.0, 11.0), 0.5)
    assert (found.value, found.n) == (5.5, 10)
    assert (2.0, 8.0) <= (found.low, found.high) <= (3.0, 9.0)
    assert pytest.approx(11.0) == found.low + found.high


@pytest.mark.parametrize(("fewest", "part"), [(6, 0.5), (72, 0.05), (72, 0.95), (13, 0.25)])
def test_quantile_is_refused_below_its_number(fewest, part) -> None:
    """A quantile asks for as many values as can lie on both of its sides."""
    assert fewest == fewest_for_quantile(part)
    assert fewest == quantile(np.arange(fewest), part).n
    with pytest.raises(EvidenceError, match="too few values"):
        quantile(np.arange(fewest - 1), part)


@pytest.mark.parametrize("statistic", ["median", "iqm"])
def test_median_and_iqm_of_success_are_refused(statistic) -> None:
    """They are 1 for most shares, so that no interval of theirs covers as it says."""
    with pytest.raises(EvidenceError, match="mean"):
        _interval([1] * 40 + [0] * 20, statistic=statistic)


def test_quantile_of_lumps_is_refused() -> None:
    """Where fewer than 60 % of the values around the median differ."""
    assert quantile(np.arange(50) % 45, 0.5).n == 50
    with pytest.raises(EvidenceError, match="too many values around the quantile are equal"):
        quantile(np.arange(50) % 20, 0.5)


def test_iqm_of_one_heap_is_refused() -> None:
    """Where nearly all of the middle half have one figure, whatever the others have."""
    values = [10.0] * 80 + list(range(20))
    with pytest.raises(EvidenceError, match="middle half"):
        _interval(values, statistic="iqm")
    assert _interval([10.0] * 40 + list(range(60)), statistic="iqm").n == 100


@pytest.mark.parametrize("part", [0.0, 1.0, -2.0])
def test_quantile_refuses_what_is_none(part) -> None:
    """There is no interval of the least and the most."""
    with pytest.raises(EvidenceError, match="no such quantile"):
        quantile(np.arange(100), part)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(-9, 9), min_size=72, max_size=90), st.sampled_from([0.05, 0.25, 0.5]))
def test_quantile_is_the_same_from_both_ends(values, part) -> None:
    """Values with the other sign have the opposite quantile with the mirrored interval."""
    values = [each + k / 1000 for k, each in enumerate(values)]
    one, two = quantile(values, part), quantile([-each for each in values], 1 - part)
    assert one.low <= one.value <= one.high
    assert (one.low, one.high) == pytest.approx((-two.high, -two.low))


def test_interval_is_plain_data() -> None:
    """An interval has JSON of its five fields."""
    document = _interval([1] * 40 + [0] * 20).to_json()
    assert list(document) == ["value", "low", "high", "n", "method"]
    assert (document["n"], document["method"]) == (60, "Wilson, of two outcomes")
