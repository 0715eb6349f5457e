"""Learning curves over checkpoints, and performance profiles."""

import json
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.errors import SpecError
from gamekeeper.evaluation.evaluator import evaluate
from gamekeeper.evaluation.spec_reader import read_spec
from gamekeeper.reporting.evaluation_text import evaluation_text
from gamekeeper.statistics.aggregates import profile
from tests.evaluation.duel import Duel, Strength


def runs(first: int) -> list[Strength]:
    """Twelve training runs."""
    return [Strength(first + k) for k in range(12)]


def point(step: int, first: int) -> dict[str, Any]:
    """A point of a curve."""
    return {"curve": "mappo", "step": step, "runs": runs(first)}


def test_curve_has_a_point_for_each_step_with_intervals_over_runs(tmp_path: Path) -> None:
    """Steps ascend; only the last one is compared with others; marl-eval has all of them."""
    spec = {
        "name": "curves",
        "environments": {"duel": {"spec": lambda: Duel(is_team=True)}},
        "policies": {
            "late": point(2_000, 60),
            "early": point(1_000, 20),
            "other": {"runs": runs(21)},
        },
    }
    found = evaluate(spec, episodes=12, marl_eval=tmp_path / "m.json")
    rows = [
        row for row in found.curves["mappo"] if (row["scope"], row["metric"]) == ("team", "return")
    ]
    assert [(row["step"], row["policy"], row["runs"]) for row in rows] == [
        (1_000, "early", 12),
        (2_000, "late", 12),
    ]
    for row in rows:
        assert row["iqm"]["low"] < row["iqm"]["value"] < row["iqm"]["high"]
    assert {(row["a"], row["b"]) for row in found.comparisons} == {("late", "other")}
    text = evaluation_text(found.to_json(), width=120)
    assert "Learning curve of mappo in duel" in text
    run = json.loads((tmp_path / "m.json").read_text())["curves"]["duel"]["mappo"]["run_0"]
    assert [run[f"step_{k}"]["step_count"] for k in (0, 1)] == [1_000, 2_000]


def test_curve_refuses_half_a_point_and_two_points_at_one_step() -> None:
    """With what to write."""
    bare: dict[str, Any] = {"environments": {"e": "x"}}
    with pytest.raises(SpecError, match="a curve and a step"):
        read_spec({**bare, "policies": {"a": {"policy": "x", "curve": "c"}}})
    two = {name: {"policy": name, "curve": "c", "step": 5} for name in "ab"}
    with pytest.raises(SpecError, match="at one step"):
        read_spec({**bare, "policies": two})


def test_profile_is_the_part_of_the_runs_above_each_score() -> None:
    """Environments count alike."""
    found = profile({"a": [0.1, 0.9], "b": [0.5, 0.6, 0.7, 0.8]}, [0.0, 0.5, 0.85, 1.0])
    assert found["share"] == pytest.approx([1.0, 0.625, 0.25, 0.0])
