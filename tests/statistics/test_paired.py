"""Effects over pairs: published figures, laws, coverage, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.paired import FEWEST, paired_effect
from gamekeeper.statistics.student import student

DIFFERENCES = st.lists(st.integers(-4, 4), min_size=FEWEST, max_size=FEWEST + 20)


def _effect(differences, *, seed=0, level=0.95):
    values = np.asarray(differences, float)
    rng = np.random.default_rng(seed)
    return paired_effect(np.zeros(len(values)), values, rng=rng, level=level)


def test_paired_effect_of_two_outcomes_gives_published_bounds() -> None:
    """The score interval for 12 and 2 of 50 discordant pairs is Tango's."""
    effect = _effect([1] * 12 + [-1] * 2 + [0] * 36)
    assert (round(effect.low, 4), round(effect.high, 4)) == (0.0611, 0.3447)
    assert pytest.approx(effect.p) == 2 * (1 + 14 + 91) / 2**14


def test_paired_effect_of_equal_outcomes_is_still_unsure() -> None:
    """Fifty equal pairs of two outcomes don't show that there is no effect."""
    effect = _effect([0] * 50)
    z2 = 1.959964**2
    assert (effect.value, effect.p) == (0.0, 1.0)
    assert (-z2 / (50 + z2), z2 / (50 + z2)) == pytest.approx((effect.low, effect.high), abs=1e-6)


def test_paired_effect_of_one_number_is_that_number() -> None:
    """Without any spread the interval is the value."""
    effect = _effect([2.5] * 60)
    assert (effect.value, effect.low, effect.high) == (2.5, 2.5, 2.5)
    assert effect.p < 1e-9


@settings(max_examples=20, deadline=None)
@given(DIFFERENCES)
def test_paired_effect_agrees_with_its_p(differences) -> None:
    """Zero is outside the interval only where p says so; the value is inside."""
    effect = _effect(differences)
    assert effect.low - 1e-9 <= effect.value <= effect.high + 1e-9
    assert np.mean(differences) == pytest.approx(effect.value)
    if set(differences) - {-1, 0, 1} and abs(effect.p - 0.05) > 1e-6:
        assert (effect.p < 0.05) == (not effect.low <= 0 <= effect.high)


@settings(max_examples=20, deadline=None)
@given(DIFFERENCES, st.sampled_from([0.5, 3.0, 100.0]))
def test_paired_effect_follows_units(differences, unit) -> None:
    """Other units of a figure change the interval by as much."""
    differences = [*differences[:-2], 4, -3]
    one, two = _effect(differences), _effect([unit * each for each in differences])
    assert (one.low * unit, one.high * unit) == pytest.approx((two.low, two.high), abs=1e-6)


@settings(max_examples=20, deadline=None)
@given(DIFFERENCES)
def test_paired_effect_widens_with_its_level(differences) -> None:
    """A higher level takes in more."""
    one, two = _effect(differences, level=0.9), _effect(differences, level=0.99)
    assert two.low <= one.low + 1e-9
    assert one.high <= two.high + 1e-9


@pytest.mark.parametrize("n", [50, 100])
@pytest.mark.parametrize("name", ["normal", "exponential", "two outcomes", "ties"])
def test_paired_effect_covers_as_it_says(name, n) -> None:
    """Of 100 simulated experiments 88 at least hold the truth, as 95 % of very many do."""
    draws = {
        "normal": (lambda rng: rng.normal(0.3, 1, n), 0.3),
        "exponential": (lambda rng: rng.exponential(1, n), 1.0),
        "two outcomes": (lambda rng: rng.choice([-1, 0, 1], p=[0.1, 0.6, 0.3], size=n), 0.2),
        "ties": (lambda rng: rng.integers(-2, 4, n), 0.5),
    }
    draw, truth = draws[name]
    effects = [_effect(draw(np.random.default_rng([n, k])), seed=k) for k in range(100)]
    assert sum(effect.low <= truth <= effect.high for effect in effects) >= 88


def test_paired_effect_refuses_too_few_pairs() -> None:
    """Below the least number of pairs nothing is claimed."""
    with pytest.raises(EvidenceError, match=f"at least {FEWEST} pairs"):
        _effect(range(FEWEST - 1))


@pytest.mark.parametrize(
    ("base", "changed"),
    [([0.0] * 50, [0.0] * 51), ([[0.0]] * 50, [[0.0]] * 50), ([0.0] * 50, [0.0] * 49 + [np.nan])],
)
def test_paired_effect_refuses_what_is_no_pair(base, changed) -> None:
    """Arms of different lengths, tables and figures that aren't finite are refused."""
    with pytest.raises(EvidenceError):
        paired_effect(np.array(base), np.array(changed), rng=np.random.default_rng(0))


def test_paired_effect_refuses_a_level_out_of_range() -> None:
    """A level of 95 isn't taken for 0.95."""
    with pytest.raises(EvidenceError, match="level"):
        _effect([1, 2] * 30, level=95)


@pytest.mark.parametrize(("freedom", "bound"), [(49, 2.0096), (99, 1.9842), (199, 1.9720)])
def test_student_gives_published_quantiles(freedom, bound) -> None:
    """The quantiles are those of the tables."""
    assert bound == pytest.approx(student(0.95, freedom), abs=2e-4)


@pytest.mark.parametrize("unit", [2.0, 0.001, 1e6])
@pytest.mark.parametrize("kind", ["one size", "counts", "normal"])
def test_paired_effect_concludes_the_same_in_other_units(kind, unit) -> None:
    """Returns of -1, 0 and 1 are judged like returns of -2, 0 and 2."""
    rng = np.random.default_rng(0)
    values = {
        "one size": rng.integers(-1, 2, 60) * 1.0,
        "counts": rng.poisson(0.3, 60) * 1.0,
        "normal": rng.normal(0.3, 1, 60),
    }[kind]
    one, two = (
        paired_effect(np.zeros(60), each * values, rng=np.random.default_rng(1), is_share=False)
        for each in (1.0, unit)
    )
    assert one.p == pytest.approx(two.p)
    assert (unit * one.low, unit * one.high) == pytest.approx((two.low, two.high))


@pytest.mark.parametrize("value", [0.0, 1.0, 2.5])
def test_paired_effect_of_equal_returns_is_refused(value) -> None:
    """Of shares it isn't: that they are 0 or 1 is known."""
    zeros, values = np.zeros(50), np.full(50, value)
    with pytest.raises(EvidenceError, match="nothing is known of its spread"):
        paired_effect(zeros, values, rng=np.random.default_rng(0), is_share=False)
    if value <= 1.0:
        found = paired_effect(zeros, values, rng=np.random.default_rng(0), is_share=True)
        assert found.high - found.low > 0.05


def test_paired_effect_has_a_p_without_a_floor() -> None:
    """Ten standard errors off is less likely than any number of resamples tells."""
    far = np.random.default_rng(0).normal(1, 1, 100)
    found = paired_effect(np.zeros(100), far, rng=np.random.default_rng(0))
    assert 0.0 < found.p < 1e-9
