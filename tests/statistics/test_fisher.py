"""Fisher's exact test against what is known of it."""

import pytest

from gamekeeper.errors import EvidenceError
from gamekeeper.statistics.significance import fisher_exact


def test_fisher_is_the_tea_tasters() -> None:
    """Three of four cups of each kind told right: 34 of 70 tables are no likelier."""
    assert fisher_exact(3, 4, 1, 4) == 34 / 70
    assert fisher_exact(4, 4, 0, 4) == 2 / 70
    assert fisher_exact(1, 4, 3, 4) == fisher_exact(3, 4, 1, 4)


def test_fisher_without_looks_says_nothing() -> None:
    """No episode on one side is no evidence."""
    assert fisher_exact(5, 5, 0, 0) == 1.0


def test_fisher_refuses_counts_that_cant_be() -> None:
    """More hits than looks."""
    with pytest.raises(EvidenceError, match="more hits than trials"):
        fisher_exact(1, 2, 3, 2)
