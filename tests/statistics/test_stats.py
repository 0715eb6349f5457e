"""Intervals, permutation tests and Holm's correction, against known figures and laws."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.significance import holm, permutation_test, sign_flip_test, wilson


def test_wilson_gives_published_bounds() -> None:
    """The interval for 1 of 10 is the one in textbooks."""
    share = wilson(1, 10)
    assert (round(share.low, 4), round(share.high, 4)) == (0.0179, 0.4042)


def test_interval_without_looks_knows_nothing() -> None:
    """No look leaves everything possible."""
    share = wilson(0, 0)
    assert (share.low, share.high, share.n) == (0.0, 1.0, 0)


@given(data=st.data())
def test_interval_holds_its_share(data) -> None:
    """The share lies in its interval, and the interval in [0, 1]."""
    looks = data.draw(st.integers(1, 200))
    share = wilson(data.draw(st.integers(0, looks)), looks)
    assert 0 <= share.low <= share.p <= share.high <= 1


def test_interval_refuses_more_hits_than_looks() -> None:
    """A share above 1 is a fault of the caller's."""
    with pytest.raises(EvidenceError):
        wilson(3, 2)


def test_permutation_test_sees_one_feature_among_many() -> None:
    """A feature that always differs has the least p-value, whatever noise stands beside it."""
    rng = np.random.default_rng(0)
    one, two = rng.normal(size=(20, 50)), rng.normal(size=(20, 50))
    one[:, 7], two[:, 7] = 1.0, 0.0
    assert permutation_test(one, two, rng=rng) == 0.001


def test_permutation_test_keeps_its_level() -> None:
    """Equal distributions are told apart in about one of twenty tests at the level of 5 %."""
    rng = np.random.default_rng(1)
    found = [
        permutation_test(rng.normal(size=(12, 5)), rng.normal(size=(12, 5)), rng=rng, rounds=99)
        for _ in range(400)
    ]
    assert sum(p <= 0.05 for p in found) <= 35


def test_permutation_test_of_constants_says_nothing() -> None:
    """What never varies can't differ."""
    same = np.ones((4, 3))
    assert permutation_test(same, same, rng=np.random.default_rng(0)) == 1.0


def test_permutation_test_refuses_other_features() -> None:
    """Samples of different things have no common distribution."""
    with pytest.raises(EvidenceError):
        permutation_test(np.ones((3, 2)), np.ones((3, 1)), rng=np.random.default_rng(0))


def test_sign_flip_test_sees_a_steady_direction() -> None:
    """Small differences that always go one way are seen; those that go both ways are not."""
    rng = np.random.default_rng(2)
    steady = np.zeros((40, 3))
    steady[::4, 1] = 1.0
    balanced = np.zeros((40, 3))
    balanced[::4, 1] = [1.0, -1.0] * 5
    assert sign_flip_test(steady, rng=rng) <= 0.01
    assert sign_flip_test(balanced, rng=rng) > 0.2


def test_sign_flip_test_refuses_no_pairs() -> None:
    """Nothing is known of no pairs."""
    with pytest.raises(EvidenceError):
        sign_flip_test(np.ones((0, 2)), rng=np.random.default_rng(0))


def test_holm_gives_published_values() -> None:
    """The corrected values are those of the script's procedure."""
    assert pytest.approx((0.03, 0.06, 0.06, 0.02)) == holm((0.01, 0.04, 0.03, 0.005))


@given(st.lists(st.floats(0, 1), max_size=20))
def test_holm_never_lowers_and_keeps_the_order(p_values: list[float]) -> None:
    """Corrected values are no smaller, no larger than 1, and ranked as before."""
    corrected = holm(p_values)
    assert all(p <= q <= 1 for p, q in zip(p_values, corrected, strict=True))
    ranked = [corrected[i] for i in sorted(range(len(p_values)), key=p_values.__getitem__)]
    assert ranked == sorted(ranked)
