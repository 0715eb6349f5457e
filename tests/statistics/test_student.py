"""Student's and the binomial distribution: published figures."""

import pytest

from gamekeeper.statistics.student import binomial_at_most, incomplete_beta, student, student_p


@pytest.mark.parametrize(
    ("bound", "level", "freedom"),
    [
        (12.7062, 0.95, 1),
        (4.6041, 0.99, 4),
        (2.2622, 0.95, 9),
        (2.0452, 0.95, 29),
        (1.9840, 0.95, 100),
    ],
)
def test_student_gives_published_quantiles(bound, level, freedom) -> None:
    """The quantiles are those of the tables, below and above the series."""
    assert bound == pytest.approx(student(level, freedom), abs=2e-4)


def test_student_takes_parts_of_a_degree() -> None:
    """Between whole degrees the quantile is between theirs, and is the tail's inverse."""
    assert student(0.95, 5) < student(0.95, 4.5) < student(0.95, 4)
    assert pytest.approx(0.05) == student_p(student(0.95, 4.5), 4.5)


def test_binomial_counts_exactly() -> None:
    """The chance of at most so many hits is the sum of the chances of each."""
    assert binomial_at_most(-1, 5, 0.3) == 0.0
    assert binomial_at_most(5, 5, 0.3) == 1.0
    assert pytest.approx(0.7**5 + 5 * 0.3 * 0.7**4) == binomial_at_most(1, 5, 0.3)


@pytest.mark.parametrize(("chance", "x"), [(0.0, -1.0), (0.0, 0.0), (0.5, 0.5), (1.0, 1.0)])
def test_incomplete_beta_runs_from_none_to_all(chance, x) -> None:
    """A symmetric one is a half in the middle."""
    assert chance == pytest.approx(incomplete_beta(3.0, 3.0, x))
