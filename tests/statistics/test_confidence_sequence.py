"""Confidence sequences: laws, coverage with the stopping, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.confidence_sequence import ConfidenceSequence

SHARES = ConfidenceSequence(0.0, 1.0)
ANY = ConfidenceSequence()


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(0, 1), min_size=1, max_size=60))
def test_sequence_holds_every_mean(values) -> None:
    """Each bound pair is inside [0, 1] and holds the mean of what was seen so far."""
    low, high = SHARES.sequence(values)
    means = np.cumsum(values) / np.arange(1, len(values) + 1)
    assert len(values) == len(low) == len(high)
    assert ((low >= 0) & (low <= means + 1e-9) & (means <= high + 1e-9) & (high <= 1)).all()


@settings(max_examples=10, deadline=None)
@given(st.lists(st.integers(0, 8), min_size=5, max_size=40), st.integers(1, 4))
def test_sequence_looks_at_no_later_value(values, more) -> None:
    """What comes later changes no earlier bound, and what could be changes only the scale."""
    shares = np.array(values) / 8
    low, high = SHARES.sequence(shares)
    longer, _ = SHARES.sequence([*shares, *[1.0] * more])
    assert list(longer[: len(low)]) == list(low)
    wide = ConfidenceSequence(-4.0, 4.0).sequence(np.array(values) - 4.0)
    assert (list(8 * low - 4), list(8 * high - 4)) == (
        pytest.approx(list(wide[0])),
        pytest.approx(list(wide[1])),
    )


def test_sequence_of_any_values_follows_shift_and_scale() -> None:
    """Other units and another zero move the bounds by as much; before the warm-up all is open."""
    values = np.random.default_rng(0).exponential(size=300)
    low, high = ANY.sequence(values)
    far_low, far_high = ANY.sequence(1e6 + 3 * values)
    warm = ANY.warm_up
    assert np.isinf(low[: warm - 1]).all()
    assert np.isinf(high[: warm - 1]).all()
    expected = [*(1e6 + 3 * low[warm:]), *(1e6 + 3 * high[warm:])]
    assert expected == pytest.approx([*far_low[warm:], *far_high[warm:]])


def test_stop_at_is_the_first_narrow_interval() -> None:
    """It stops where the width is met, not before and not where it never is."""
    values = (np.random.default_rng(0).random(500) < 0.9) * 1.0
    stop = SHARES.stop_at(values, 0.2)
    low, high = SHARES.sequence(values)
    assert stop is not None
    assert high[stop - 1] - low[stop - 1] <= 0.2 < (high - low)[: stop - 1].min()
    assert SHARES.stop_at(values, 0.01) is None
    assert SHARES.stop_at([], 0.2) is None


def test_sequences_watched_together_are_wider() -> None:
    """A higher level, as several sequences at once ask for, holds the lower one's interval."""
    values = np.random.default_rng(0).random(200)
    one, ten = SHARES.interval(values), ConfidenceSequence(0.0, 1.0, 0.995).interval(values)
    assert ten.low < one.low < one.value < one.high < ten.high


def test_interval_is_the_last_of_the_sequence() -> None:
    """What is told after stopping is the sequence's own interval, and says so."""
    values = np.random.default_rng(0).normal(5, 2, 200)
    found, (low, high) = ANY.interval(values), ANY.sequence(values)
    assert (low[-1], high[-1], 200) == (found.low, found.high, found.n)
    assert found.low < found.value < found.high
    assert "confidence sequence" in found.method


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ConfidenceSequence(0.0, None), "no such bounds"),
        (lambda: ConfidenceSequence(1.0, 1.0), "no such bounds"),
        (lambda: ConfidenceSequence(level=0.2), "no interval of this level"),
        (lambda: SHARES.sequence([0.5, 1.2]), "outside of its bounds"),
        (lambda: ANY.sequence([0.5, np.nan]), "finite"),
        (lambda: ANY.stop_at([0.5], 0.0), "can.t be 0 or less"),
        (lambda: ANY.interval(np.zeros(50)), "at least 100 values"),
    ],
)
def test_sequence_refuses(make, message) -> None:
    """Half a pair of bounds, values outside, no width and too few values are refused."""
    with pytest.raises(EvidenceError, match=message):
        make()


def test_sequence_covers_with_the_stopping() -> None:
    """Stopped when narrow, at least 95 of 100 hold the truth of a share."""
    held = 0
    for seed in range(60):
        values = (np.random.default_rng(seed).random(150) < 0.8) * 1.0
        low, high = SHARES.sequence(values)
        stop = int(np.argmax(high - low <= 0.32))
        held += stop > 0 and low[stop] <= 0.8 <= high[stop]
    assert held >= 57


def test_asymptotic_sequence_covers_with_the_stopping() -> None:
    """So do skewed returns without bounds."""
    held = 0
    for seed in range(300):
        values = np.random.default_rng(seed).exponential(size=1500)
        low, high = ANY.sequence(values)
        stop = ANY.stop_at(values, 0.4)
        held += stop is not None and low[stop - 1] <= 1.0 <= high[stop - 1]
    assert held >= 285
