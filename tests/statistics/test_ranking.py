"""Cycles, and alpha-rank."""

import numpy as np
import pytest

from gamekeeper.statistics.ranking import alpha_rank, cycle_of

ROCK = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], bool)
"""Rock, script, scissors."""


def test_cycle_of_rock_paper_scissors_goes_round() -> None:
    """Each beats the next; an order has none."""
    cycle = cycle_of(ROCK)
    assert sorted(cycle) == [0, 1, 2]
    assert all(ROCK[a, b] for a, b in zip(cycle, [*cycle[1:], cycle[0]], strict=True))
    assert cycle_of(np.triu(np.ones((4, 4), bool), 1)) == []


def test_alpha_rank_of_a_cycle_is_even_and_of_an_order_is_the_best() -> None:
    """A policy that beats the whole cycle is what is played."""
    assert alpha_rank(ROCK) == pytest.approx([1 / 3] * 3)
    whole = np.zeros((4, 4), bool)
    whole[:3, :3], whole[3, :3] = ROCK, True
    found = alpha_rank(whole)
    assert found.sum() == pytest.approx(1)
    assert found[3] > 0.9
    assert alpha_rank(np.zeros((1, 1), bool)).tolist() == [1.0]
