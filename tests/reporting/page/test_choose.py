"""Episodes come on the page in the order in which a reader asks for them, under a budget."""

import numpy as np
import pytest

from gamekeeper.errors import EvidenceError
from gamekeeper.reporting.page.episode_figures import Figures
from gamekeeper.reporting.page.episode_list import MISSES, Budget, chosen_text, order_of


def figures(returns: list[float], *, torn: int | None = None) -> Figures:
    """One agent's returns; the recorder of episode `torn` was killed."""
    column = np.array(returns)[:, None]
    flags = np.zeros(column.shape, np.bool_)
    headers = tuple(
        {"episode": number, "end": "torn" if number == torn else "ended"}
        for number in range(len(returns))
    )
    return Figures(headers, ("a",), ~flags, column, column, {}, flags, flags, column)


def test_named_labelled_failing_median_best_come_first() -> None:
    """Each with its reasons; the rest follows, spread over the run."""
    order = order_of(
        figures([5, 1, 9, 2, 3, 4, 0, 6, 7, 8]),
        failing=[False, True, False, False, False, False, True, False, False, False],
        named=[7],
        labelled=[3],
        diverging=[3, 0],
    )
    expected = [
        (7, ("named",)),
        (3, ("label", "divergence")),
        (0, ("divergence",)),
        (1, ("failing",)),
        (5, ("median",)),
        (2, ("best",)),
        (6, ("failing",)),
        (9, ()),
    ]
    assert expected == order[:8]
    assert set(range(10)) == {number for number, _ in order}


def test_episode_that_was_torn_comes_before_all_but_named_ones() -> None:
    """What a killed run was doing last is what a reader of it asks for."""
    order = order_of(figures([1, 2, 3], torn=2), failing=[True, None, None], named=[1])
    assert order[:2] == [(1, ("named", "median")), (2, ("unfinished", "best"))]


def test_named_episode_must_be_there() -> None:
    """A number that the run hasn't is refused."""
    with pytest.raises(EvidenceError, match="no episode 5"):
        order_of(figures([1, 2]), failing=[None, None], named=[5])


def test_no_episodes_have_no_order() -> None:
    """An empty run has nothing to choose."""
    assert order_of(figures([]), failing=[]) == []


def test_budget_is_kept_and_soon_given_up() -> None:
    """What doesn't fit isn't taken, smaller ones still are, and after some misses it ends."""
    budget = Budget(100)
    assert [budget.take(60), budget.take(60), budget.take(30)] == [True, False, True]
    assert not budget.is_spent
    for _ in range(MISSES):
        budget.take(1_000)
    assert budget.is_spent


def test_what_is_left_out_is_said() -> None:
    """The page says which episodes it holds and what shows the others; of all it says nothing."""
    assert chosen_text([(0, ()), (1, ())], 2, run="r") == ""
    text = chosen_text([(3, ("failing",)), (1, ())], 9, run="runs/r")
    assert "2 of 9 episodes" in text
    assert "1, 3 (failing)" in text
    assert "gamekeeper view runs/r" in text
