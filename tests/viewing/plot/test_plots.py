"""Plots show what the evidence or the evaluation says, and refuse what it doesn't."""

import re
from collections.abc import Iterator
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.viewing.plot.plot_axes import COLORS, DARK_COLORS, color
from tests.surface.sources import ROOT


@pytest.fixture(autouse=True, scope="module")
def _no_display() -> Iterator[None]:
    """Figures are drawn into memory, and closed."""
    before = mpl.get_backend()
    mpl.use("Agg")
    yield
    plt.close("all")
    mpl.use(before)


@pytest.fixture(scope="module")
def evidence() -> gk.Evidence:
    """Four episodes on a line, one robot waiting."""
    policies = {"picker": "lazy", "carrier": "reference"}
    return gk.rollout("two_robot_line", policies=policies, episodes=4, seed=0)


def row(policy: str, value: float, **more: Any) -> dict[str, Any]:
    """A row of results about the team's return."""
    figure = {"value": value, "low": value - 1, "high": value + 1}
    given = {"environment": "line", "policy": policy, "run": 0, "scope": "team", "who": "team"}
    return {**given, "metric": "return", "mean": figure, "iqm": None, **more}


def evaluation(**more: Any) -> gk.Evaluation:
    """An evaluation of two policies."""
    results = (row("a", 1.0), row("b", 3.0), row("b", 9.0, metric="length"))
    return gk.Evaluation(name="two", results=results, **more)


def test_returns_show_a_dot_for_each_episode_and_refuse_short_intervals(
    evidence: gk.Evidence,
) -> None:
    """Agents stand in the roster's order; four episodes have no interval, and the label says so."""
    axes = gk.plot.returns(evidence)
    assert [label.get_text() for label in axes.get_yticklabels()] == ["picker", "carrier"]
    assert [len(each.get_offsets()) for each in axes.collections] == [4, 4]
    assert all(len(line.get_xdata()) == 1 for line in axes.lines)
    assert "needs 95 episodes" in axes.get_xlabel()
    assert evidence.fingerprint[:12] in axes.get_title(loc="left")


def test_plots_draw_on_the_axes_that_they_are_given(evidence: gk.Evidence) -> None:
    """`ax=` is drawn on and returned; no other figure is made."""
    axes = plt.figure().subplots()
    figures = plt.get_fignums()
    assert axes is gk.plot.returns(evidence, ax=axes)
    assert plt.get_fignums() == figures


def test_heatmap_has_the_shares_of_actions(evidence: gk.Evidence) -> None:
    """Rows add up to 1; the waiting robot has one action, under its declared name."""
    axes = gk.plot.heatmap(evidence)
    shares = np.asarray(axes.images[0].get_array())
    assert pytest.approx(shares.sum(axis=1).tolist()) == [1.0, 1.0]
    assert shares[0].max() == 1.0
    assert "stay" in [label.get_text() for label in axes.get_xticklabels()]


def test_heatmap_counts_turns_at_places(evidence: gk.Evidence) -> None:
    """The waiting robot was in its cell in every turn, and nowhere else."""
    axes = gk.plot.heatmap(evidence, of="places", agent="picker")
    turns = sum(episode.header["turns"] + 1 for episode in evidence.episodes)
    assert turns == np.nansum(np.asarray(axes.images[0].get_array().filled(np.nan)))
    with pytest.raises(gk.EvidenceError, match="no places of carrier_7"):
        gk.plot.heatmap(evidence, of="places", agent="carrier_7")


def test_intervals_have_a_line_for_each_policy_that_has_one() -> None:
    """Only rows about returns are shown; a figure without interval is an open circle."""
    bare = row("c", 2.0, mean={"value": 2.0, "low": None, "high": None})
    found = evaluation()
    axes = gk.plot.intervals(gk.Evaluation(name="three", results=(*found.results, bare)))
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "b", "c"]
    wide = [line.get_xdata().tolist() for line in axes.lines if len(line.get_xdata()) == 2]
    assert wide == [[0.0, 2.0], [2.0, 4.0]]
    assert mpl.colors.same_color(axes.lines[-1].get_markerfacecolor(), axes.get_facecolor())


def test_curves_follow_the_steps() -> None:
    """Points ascend, whatever their order was; without curves it is refused with the fix."""
    points = [row("late", 2.0, step=20), row("early", 1.0, step=10)]
    axes = gk.plot.curves(evaluation(curves={"mappo": points}), statistic="mean")
    assert list(axes.lines[0].get_xdata()) == [10, 20]
    assert list(axes.lines[0].get_ydata()) == [1.0, 2.0]
    with pytest.raises(gk.EvidenceError, match="no learning curve") as caught:
        gk.plot.curves(evaluation())
    assert "a curve and a step" in caught.value.fix


def test_profiles_are_those_of_the_score() -> None:
    """Score comes before success; without several environments there is none."""
    shape = {"tau": [0.0, 1.0], "share": [1.0, 0.0]}
    results = [
        {"policy": "a", "metric": metric, "environments": 2, "unit": "run", "profile": shape}
        for metric in ("success", "score")
    ]
    axes = gk.plot.profiles(evaluation(overall={"results": results}))
    assert (axes.get_xlabel(), len(axes.lines)) == ("score", 1)
    with pytest.raises(gk.EvidenceError, match="no profile"):
        gk.plot.profiles(evaluation())


def test_crossplay_is_the_matrix_of_means() -> None:
    """A row for the policy in the first role; a pair that never met is empty."""
    cells = [
        {"roles": {"p": p, "c": c}, "kind": "fixed", "mean": mean, "low": 0.0, "high": 9.0}
        for p, c, mean in (("a", "a", 1.0), ("a", "b", 2.0), ("b", "a", 3.0))
    ]
    played = {"line": {"roles": ["p", "c"], "policies": ["a", "b"], "cells": cells}}
    axes = gk.plot.crossplay(evaluation(crossplay=played))
    means = np.asarray(axes.images[0].get_array().filled(np.nan))
    assert means[~np.isnan(means)].tolist() == [1.0, 2.0, 3.0]
    assert "1\n0 to 9" in [text.get_text() for text in axes.texts]
    with pytest.raises(gk.EvidenceError, match="no cross-play"):
        gk.plot.crossplay(evaluation())


def test_colours_are_those_of_the_pages() -> None:
    """An agent has one colour in plots and in the player, in the light and in a dark style."""
    style = ROOT / "src/gamekeeper/reporting/page/assets/style.css"
    series = re.findall(r"--series-\d: (#\w+);", style.read_text(encoding="utf-8"))
    assert [*COLORS, *DARK_COLORS] == series
    assert color(1) == COLORS[1]
    with mpl.style.context("dark_background"):
        assert color(len(COLORS) + 1) == DARK_COLORS[1]
        axes = gk.plot.intervals(evaluation())
        assert axes.lines[0].get_color() == DARK_COLORS[0]
