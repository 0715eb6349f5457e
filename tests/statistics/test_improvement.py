"""The probability of improvement: known figures, laws, coverage, refusals."""

from itertools import product
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.aggregates import improvement, probability_of_improvement
from gamekeeper.statistics.paired import exact_wins

RUNS = st.lists(st.integers(-6, 6), min_size=10, max_size=15)
PAIRS = st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3)), min_size=50, max_size=60)


@settings(deadline=None)
@given(RUNS, RUNS)
def test_probability_of_improvement_counts_pairs(a, b) -> None:
    """It is the part of all pairs that `a` wins, ties counting half; both sides add up to 1."""
    wins = [(one > two) + (one == two) / 2 for one in a for two in b]
    assert pytest.approx(np.mean(wins)) == probability_of_improvement(a, b)
    assert pytest.approx(1.0) == probability_of_improvement(a, b) + probability_of_improvement(b, a)


@settings(deadline=None, max_examples=50)
@given(RUNS, RUNS)
def test_improvement_changes_sides(a, b) -> None:
    """The other side's interval is the mirror image; the estimate is inside."""
    one, two = improvement(a, b, paired=False), improvement(b, a, paired=False)
    assert 0 <= one.low <= one.value <= one.high <= 1
    expected = (1 - two.high, 1 - two.value, 1 - two.low)
    assert expected == pytest.approx((one.low, one.value, one.high))


@settings(deadline=None, max_examples=50)
@given(PAIRS, st.sampled_from([0.5, 7.0]), st.integers(-5, 5))
def test_improvement_of_pairs_changes_sides_and_bears_units(pairs, scale, shift) -> None:
    """Mirrored, and the same in other units."""
    a, b = np.array(pairs, float).T
    one, two = improvement(a, b, paired=True), improvement(b, a, paired=True)
    assert 0 <= one.low <= one.value <= one.high <= 1
    assert (1 - two.high, 1 - two.low) == pytest.approx((one.low, one.high))
    assert one == improvement(scale * a + shift, scale * b + shift, paired=True)


def test_improvement_of_paired_episodes_isnt_that_of_any_two() -> None:
    """Always a little better on the same seed: surely better there, hardly of any two episodes."""
    seeds = np.random.default_rng(0).normal(size=50)
    paired = improvement(seeds + 0.01, seeds, paired=True)
    independent = improvement(seeds + 0.01, seeds, paired=False)
    assert paired.low > 0.9
    assert independent.low < 0.5 < independent.value < independent.high


def test_improvement_of_surely_better_runs_is_still_unsure() -> None:
    """Ten runs that beat ten others don't show that all do."""
    found = improvement(np.arange(10) + 100, np.arange(10), paired=False)
    assert (found.value, found.high) == (1.0, 1.0)
    assert 0.7 < found.low < 0.95


def test_improvement_over_environments_is_the_mean_and_surer() -> None:
    """Environments are weighed alike, in whatever order they come."""
    rng = np.random.default_rng(0)
    a = {name: rng.normal(0.5, 1, 10) for name in "pqrs"}
    b = {name: rng.normal(0, 1, 12) for name in "srqp"}
    found = improvement(a, b, paired=False)
    alone = [improvement(a[name], b[name], paired=False) for name in a]
    assert np.mean([each.value for each in alone]) == pytest.approx(found.value)
    assert found.high - found.low < min(each.high - each.low for each in alone)


@pytest.mark.parametrize(
    ("a", "b", "paired", "message"),
    [
        (list(range(9)), list(range(12)), False, "at least 10 values"),
        (list(range(50)), list(range(51)), True, "can't be paired"),
        ({"x": list(range(10))}, {"y": list(range(10))}, False, "different environments"),
        ({}, {}, False, "environments"),
        ([np.nan] * 50, [0] * 50, True, "finite"),
    ],
)
def test_improvement_refuses(a, b, paired, message) -> None:
    """Too few, unequal, misnamed and missing figures are refused with their reason."""
    with pytest.raises(EvidenceError, match=message):
        improvement(a, b, paired=paired)


@pytest.mark.parametrize(("truth", "shift"), [(0.5, 0.0), (0.7602, 1.0)])
def test_improvement_covers_as_it_says(truth, shift) -> None:
    """With ten runs of each near 95 of 100 intervals hold the truth."""
    held = 0
    for seed in range(400):
        a, b = np.random.default_rng(seed).normal(size=(2, 10))
        found = improvement(a + shift, b, paired=False)
        held += found.low <= truth <= found.high
    assert 366 <= held <= 394


@pytest.mark.parametrize("n", [1, 5, 12, 30])
@pytest.mark.parametrize("ties", [0.0, 0.2])
@pytest.mark.parametrize("win", [0.03, 0.4, 0.75])
def test_few_pairs_are_covered_as_their_interval_says(n: int, ties: float, win: float) -> None:
    """Summed over all outcomes of n pairs, the chance that the bounds hold the truth is 95 %."""
    loss = 1 - ties - win
    covered = 0.0
    for wins, losses in product(range(n + 1), repeat=2):
        equal = n - wins - losses
        if equal < 0 or (ties == 0 and equal):
            continue
        low, high = exact_wins(wins, losses, n, 0.95)
        ways = comb(n, wins) * comb(n - wins, losses)
        covered += (low <= win + ties / 2 <= high) * ways * win**wins * loss**losses * ties**equal
    assert covered >= 0.95


def test_few_pairs_have_an_interval() -> None:
    """30 wins of 30 are above half by far; the bounds are Clopper's and Pearson's."""
    found = improvement(list(range(1, 31)), [0] * 30, paired=True)
    assert (found.value, found.high, found.n) == (1.0, 1.0, 30)
    assert found.low == pytest.approx(0.025 ** (1 / 30))
