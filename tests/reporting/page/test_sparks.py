"""Sparklines of a run are the rewards so far, on one scale."""

import numpy as np

import gamekeeper as gk
from gamekeeper.reporting.page.episode_figures import SPARK, figures_of
from gamekeeper.reporting.page.episode_list import SCALE, bars_of, sparks_of


def test_sparkline_ends_at_the_return_on_one_scale() -> None:
    """The last part has the whole return; the run's highest is the last letter, 0 the first."""
    figures = figures_of(gk.rollout("two_robot_line", episodes=6, seed=0))
    np.testing.assert_allclose(figures.cumulative[:, -1], figures.team)
    sparks = sparks_of(figures)
    assert {len(spark) for spark in sparks} == {SPARK}
    best = int(np.argmax(figures.team))
    assert (sparks[best][0], sparks[best][-1]) == (SCALE[0], SCALE[-1])


def test_bars_are_shares_of_actions() -> None:
    """An episode of one action alone has a full bar; the others of the run have none."""
    figures = figures_of(gk.rollout("two_robot_line", policies="first-legal", episodes=2, seed=0))
    assert bars_of(figures) == [SCALE[-1]] * 2
    assert figures.actions.sum() == figures.lengths.sum()
