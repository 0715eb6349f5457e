"""Intervals that are watched until they are narrow: laws, coverage with the stopping, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.narrowing import Narrowing
from gamekeeper.statistics.significance import wilson
from gamekeeper.statistics.student import student

SHARES = Narrowing(0.0, 1.0)
ANY = Narrowing()


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 4), min_size=50, max_size=70), st.integers(1, 4))
def test_sequence_holds_its_means_and_looks_at_no_later_value(values, more) -> None:
    """Bounds hold the mean so far, are inside [0, 1], and don't change by what comes later."""
    shares = np.array(values) / 4
    low, high = SHARES.sequence(shares)
    means = np.cumsum(shares) / np.arange(1, len(shares) + 1)
    told = slice(SHARES.warm_up - 1, None)
    assert ((low <= means + 1e-9) & (means <= high + 1e-9)).all()
    assert ((low[told] >= 0) & (high[told] <= 1)).all()
    longer, _ = SHARES.sequence([*shares, *[1.0, 0.1] * more])
    assert list(low) == pytest.approx(list(longer[: len(low)]))


def test_sequence_of_any_values_follows_shift_and_scale() -> None:
    """Other units and another zero move the bounds by as much; before the warm-up all is open."""
    values = np.random.default_rng(0).exponential(size=300)
    low, high = ANY.sequence(values)
    far_low, far_high = ANY.sequence(1e6 + 3 * values)
    assert np.isinf([*low[: ANY.warm_up - 1], *high[: ANY.warm_up - 1]]).all()
    told = slice(ANY.warm_up - 1, None)
    assert [*(1e6 + 3 * low[told]), *(1e6 + 3 * high[told])] == pytest.approx(
        [*far_low[told], *far_high[told]]
    )


def test_sequence_is_at_least_students_and_follows_the_skew() -> None:
    """Neither side is nearer than Student's; of skewed values the far side is farther."""
    values = np.random.default_rng(1).lognormal(size=200)
    found, reach = ANY.interval(values), student(0.95, 199) * values.std(ddof=1) / 200**0.5
    assert found.low <= found.value - reach + 1e-9
    assert found.high > found.value + 1.1 * reach
    mirrored = ANY.interval(-values)
    assert (-mirrored.high, -mirrored.low) == pytest.approx((found.low, found.high))


@pytest.mark.parametrize(("least", "most"), [(0.0, 1.0), (-2.0, 5.0)])
def test_sequence_of_two_outcomes_is_wilson(least, most) -> None:
    """Success and failure, or two returns, have the interval of their share."""
    hits = np.random.default_rng(0).random(200) < 0.8
    found = Narrowing().interval(np.where(hits, most, least))
    share = wilson(int(hits.sum()), 200)
    wide = most - least
    assert (least + wide * share.low, least + wide * share.high) == pytest.approx(
        (found.low, found.high)
    )
    assert "Wilson" in found.method


def test_sequence_of_nothing_but_success_is_still_unsure() -> None:
    """Where the bounds are known, a hundred successes don't show that there is no failure."""
    found = SHARES.interval(np.ones(100))
    assert (wilson(100, 100).low, 1.0) == pytest.approx((found.low, found.high))
    flat = ANY.interval(np.full(200, 2.5))
    assert pytest.approx((flat.low, flat.high)) == (2.5, 2.5)


def test_stop_at_is_the_first_narrow_interval() -> None:
    """It stops where the width is met, not before and not where it never is."""
    values = (np.random.default_rng(0).random(500) < 0.7) * 1.0
    stop = SHARES.stop_at(values, 0.2)
    low, high = SHARES.sequence(values)
    assert stop is not None
    assert high[stop - 1] - low[stop - 1] <= 0.2 < (high - low)[: stop - 1].min()
    assert SHARES.stop_at(values, 0.01) is None
    assert SHARES.stop_at([], 0.2) is None


@pytest.mark.parametrize("name", ["normal", "exponential", "success"])
def test_narrowing_covers_with_the_stopping(name) -> None:
    """Stopped when narrow, near 95 of 100 hold the truth."""
    held = 0
    for seed in range(400):
        rng = np.random.default_rng(seed)
        values = {
            "normal": lambda rng: rng.normal(1, 1, 300),
            "exponential": lambda rng: rng.exponential(1, 300),
            "success": lambda rng: (rng.random(300) < 0.8) * 1.0,
        }[name](rng)
        kind, width, truth = (SHARES, 0.2, 0.8) if name == "success" else (ANY, 0.3, 1.0)
        stop = kind.stop_at(values, width) or len(values)
        low, high = kind.sequence(values)
        held += low[stop - 1] <= truth <= high[stop - 1]
    assert 366 <= held <= 394


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Narrowing(0.0, None), "no such bounds"),
        (lambda: Narrowing(level=0.2), "no interval of this level"),
        (lambda: SHARES.sequence([0.5, 1.2]), "outside of its bounds"),
        (lambda: ANY.sequence([0.5, np.nan]), "finite"),
        (lambda: ANY.stop_at([0.5], 0.0), "can.t be 0 or less"),
        (lambda: ANY.interval(np.zeros(149)), "at least 150 values"),
        (lambda: SHARES.interval(np.zeros(49)), "at least 50 values"),
    ],
)
def test_narrowing_refuses(make, message) -> None:
    """Half a pair of bounds, values outside, no width and too few values are refused."""
    with pytest.raises(EvidenceError, match=message):
        make()
