"""Figures over environments."""

import numpy as np
import pytest

from gamekeeper.errors import SpecError
from gamekeeper.evaluation.estimates import Judge
from gamekeeper.evaluation.evaluator import evaluate
from gamekeeper.evaluation.spec_reader import read_spec

TWO = {
    "short": {"spec": "two_robot_line", "kwargs": {"horizon": 6}, "score": [0, 2]},
    "long": {"spec": "two_robot_line", "kwargs": {"n": 7, "horizon": 6}, "score": [0, 4]},
}


def test_overall_puts_scores_together_that_share_a_scale() -> None:
    """Success as it is; returns where every environment says what counts as 0 and 1."""
    spec = {"environments": TWO, "policies": {"reference": "reference", "random": "random"}}
    found = evaluate(spec, episodes=50).overall
    rows = {(row["policy"], row["metric"]): row for row in found["results"]}
    assert rows["reference", "success"]["mean"]["value"] == 1.0
    assert rows["reference", "score"]["mean"]["value"] == 0.75
    assert rows["reference", "score"]["optimality_gap"]["value"] == 0.25
    assert rows["reference", "score"]["mean"]["low"] is None  # one checkpoint
    chance = {row["metric"]: row["improvement"] for row in found["comparisons"]}["success"]
    assert 0.5 < chance["value"] <= 1.0
    assert chance["low"] > 0.5


def test_overall_without_a_shared_scale_is_refused() -> None:
    """Returns of different tasks have nothing in common."""
    bare = {name: {"spec": "tictactoe", "most_turns": 3 + k} for k, name in enumerate("ab")}
    spec = {"environments": bare, "policies": {"random": "random"}}
    spec["environments"]["a"]["success"] = {"player": "length > 2"}  # type: ignore[index]  # plain JSON
    found = evaluate(spec, episodes=2)
    assert found.overall["results"] == []
    assert any("no scale is shared" in row["why"] for row in found.refused)


def test_overall_of_methods_has_intervals_over_runs() -> None:
    """Runs within environments; unequal numbers of runs have no interquartile mean."""
    rng, judge = np.random.default_rng(0), Judge(0.95, 0)
    scores = {name: rng.random((16, 20)) for name in "ab"}
    found = judge.environments(scores, "iqm", of="m", name=["m"])
    assert found is not None
    assert found["low"] < found["value"] < found["high"]
    scores["a"] = scores["a"][:15]
    assert judge.environments(scores, "iqm", of="m", name=["m"]) is None
    assert any("interquartile mean over all" in row["what"] for row in judge.refused)


def test_score_is_two_different_returns() -> None:
    """What counts as 0, and what as 1."""
    with pytest.raises(SpecError, match="two different returns"):
        read_spec(
            {"environments": {"e": {"spec": "x", "score": [1, 1]}}, "policies": {"a": "random"}}
        )
