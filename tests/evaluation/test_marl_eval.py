"""marl-eval's layout."""

import json
from pathlib import Path

import pytest

from gamekeeper.errors import RunError
from gamekeeper.evaluation.evaluator import RESULT, evaluate


@pytest.mark.parametrize("name", [".", "file/x", "nowhere/x"])
def test_marl_eval_says_that_it_cant_be_written(name: str, tmp_path: Path) -> None:
    """What was played is in `out` by then."""
    (tmp_path / "file").touch()
    with pytest.raises(RunError, match="can't be written"):
        evaluate(
            {
                "name": "lines",
                "environments": {"short": "two_robot_line"},
                "policies": {"one": "noop"},
            },
            episodes=2,
            marl_eval=tmp_path / name,
            out=tmp_path / "out",
        )
    assert (tmp_path / "out" / RESULT).exists()


def test_marl_eval_has_environment_task_algorithm_run_and_step(tmp_path: Path) -> None:
    """A tenth of the episodes as a step, all of them as absolute metrics."""
    path = tmp_path / "m.json"
    evaluate(
        {
            "name": "lines",
            "environments": {"short": "two_robot_line"},
            "policies": {"one": "reference", "many": ["random", {"picker": "random", "*": "noop"}]},
        },
        episodes=20,
        marl_eval=path,
    )
    task = json.loads(path.read_text())["lines"]["short"]
    assert {n: list(r) for n, r in task.items()} == {"one": ["run_0"], "many": ["run_0", "run_1"]}
    run = task["one"]["run_0"]
    assert run["step_0"]["step_count"] == 0
    assert (len(run["step_0"]["return"]), len(run["absolute_metrics"]["return"])) == (2, 20)
    assert {"return", "success", "return_picker", "return_carrier"} == set(run["absolute_metrics"])
    assert run["absolute_metrics"]["return"] == [2.0] * 20
