"""Suites: what makes them what they are, and what others cite."""

from __future__ import annotations

from pathlib import Path

import pytest

from gamekeeper.evaluation.evaluator import evaluate
from gamekeeper.evaluation.spec_reader import read_file
from gamekeeper.evaluation.suites import suite_named, suites

TEXT = """
name = "small"
[suite]
id = "small-1"
[environments.line]
spec = "two_robot_line"
[seeds]
episodes = 2
[policies.reference]
policy = "reference"
[policies.random]
policy = "random"
"""


@pytest.fixture(name="path")
def _path(tmp_path: Path) -> Path:
    """The file of a suite."""
    path = tmp_path / "small.toml"
    path.write_text(TEXT)
    return path


def test_suites_of_ours_can_be_read_and_are_named_by_their_ids() -> None:
    """Each file is called as its suite is."""
    found = suites()
    assert {"gk-tasks-1", "gk-board-games-1", "gk-noisy-warehouse-1"} <= set(found)
    for name, path in found.items():
        spec = read_file(path)
        assert spec.suite is not None
        assert name == spec.suite[0]
        assert suite_named(name) == spec
    assert suite_named("no-such-suite") is None


def test_suite_results_carry_its_id_and_fingerprint(path: Path) -> None:
    """So that a paper can cite them."""
    found = evaluate(path)
    assert found.suite is not None
    assert (found.suite["id"], found.suite["version"]) == ("small-1", "1")
    assert len(found.suite["fingerprint"]) == 32
    assert evaluate(path, seed=1).suite != found.suite
    assert found.commands == (f"gamekeeper evaluate {path}",)
