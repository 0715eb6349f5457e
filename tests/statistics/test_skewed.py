"""How far a mean's t goes by the shape of the values."""

import numpy as np
import pytest

from gamekeeper.statistics.one_sample import _far_tail, reach_of_mean, stretches
from gamekeeper.statistics.resampling import reach, t_of_means
from gamekeeper.statistics.significance import wilson
from gamekeeper.statistics.student import student


def _standard(values):
    values = np.asarray(values, float)
    return (values - values.mean()) / values.std(ddof=1)


def test_stretches_leave_upright_values_alone() -> None:
    """What chance brings isn't stretched; a long tail on a side is, on that side alone."""
    assert [float(each) for each in stretches(np.float64(0.15), 2.5)] == [1.0, 1.0]
    assert [float(each) for each in stretches(np.float64(0.4), 2.5)] == pytest.approx([1.5, 1.0])
    assert [float(each) for each in stretches(np.float64(-0.4), 2.5)] == pytest.approx([1.0, 1.5])


def test_reach_of_mean_of_upright_values_is_the_bootstraps() -> None:
    """Of values without skew it is between the equal-tailed and the symmetric interval."""
    values = _standard(np.random.default_rng(0).normal(size=60))
    t = t_of_means(values, np.random.default_rng(1))
    both = np.quantile(np.abs(t), 0.95)
    least, most = reach_of_mean(t, values, 0.95)
    equal = np.quantile(t, [0.025, 0.975])
    assert float(least) == pytest.approx(0.75 * equal[0] - 0.25 * both, abs=1e-6)
    assert float(most) == pytest.approx(0.75 * equal[1] + 0.25 * both, abs=1e-6)


def test_reach_of_mean_goes_farther_where_values_lean_from() -> None:
    """Of values with rare high ones the mean may be farther under the truth."""
    values = _standard(np.random.default_rng(1).gamma(0.7, 1, 40))
    lean = float((values**3).mean() / (values**2).mean() ** 1.5 / 40**0.5)
    t = t_of_means(values, np.random.default_rng(1))
    least, most = reach_of_mean(t, values, 0.95)
    plain = reach(t, 39)(0.95)
    assert lean > 0.25
    assert least < plain[0] < -student(0.95, 39)
    assert 0 < most < student(0.95, 39)


@pytest.mark.parametrize("hits", [8, 60, 95])
def test_reach_of_mean_of_two_heaps_is_wilsons_at_most(hits: int) -> None:
    """Two heaps are told apart from two outcomes by their width alone."""
    rng = np.random.default_rng(0)
    values = np.where(np.arange(100) < hits, 1.0, 0.0) + rng.normal(0, 1e-3, 100)
    standard = _standard(values)
    least, most = reach_of_mean(t_of_means(standard, rng), standard, 0.95)
    error = values.std(ddof=1) / 10
    share = wilson(hits, 100)
    assert share.low - 0.003 <= values.mean() - most * error
    assert values.mean() - least * error <= share.high + 0.003


def test_reach_of_mean_takes_many_at_once() -> None:
    """Rows of samples have the reach that each of them has alone."""
    values = np.stack([_standard(each) for each in np.random.default_rng(0).gamma(2, 1, (3, 25))])
    t = np.stack([t_of_means(each, np.random.default_rng(1)) for each in values])
    together = np.stack(reach_of_mean(t, values, 0.95))
    alone = np.stack([reach_of_mean(*pair, 0.95) for pair in zip(t, values, strict=True)])
    np.testing.assert_allclose(together.T, alone)


def test_reach_of_mean_knows_of_values_that_most_samples_lack() -> None:
    """Log-normal values of sigma 2 reach farther, on the side of their tail alone."""
    rng = np.random.default_rng(3)
    values = _standard(rng.lognormal(0, 2, 100))
    t = t_of_means(values, rng)
    least, most = reach_of_mean(t, values, 0.95)
    lean = np.float64((values**3).mean() / (values**2).mean() ** 1.5 / 10)
    assert float(_far_tail(values, lean)) > 1.5
    assert float(least) < -1.5 * student(0.95, 99)
    mirrored = reach_of_mean(-t, -values, 0.95)
    assert (-float(mirrored[1]), -float(mirrored[0])) == pytest.approx((float(least), float(most)))


@pytest.mark.parametrize("shape", ["normal", "exponential", "zeros", "a crash"])
def test_reach_of_mean_of_ordinary_values_is_no_farther(shape) -> None:
    """Values without a tail, with a mild one, with a lump at their floor, and with a rare loss."""
    rng = np.random.default_rng(5)
    values = {
        "normal": rng.normal(size=100),
        "exponential": rng.exponential(size=100),
        "zeros": (rng.random(100) < 0.3) * rng.gamma(2, 1, 100),
        "a crash": rng.normal(size=100) - 30.0 * (rng.random(100) < 0.03),
    }[shape]
    lean = np.float64((_standard(values) ** 3).mean() / 10)
    assert float(_far_tail(values, lean)) == 1.0
