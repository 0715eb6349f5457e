"""Suites: what makes them what they are, pins, and what others cite."""

import tomllib
from pathlib import Path

import pytest
import tomli_w

from gamekeeper.errors import SpecError
from gamekeeper.evaluation.evaluator import evaluate, inspected
from gamekeeper.evaluation.spec_reader import read_file
from gamekeeper.evaluation.suites import fingerprint_of, pinned, suite_named, suites

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


def test_suite_has_one_fingerprint_before_and_after_it_is_pinned(path: Path) -> None:
    """Pins are no part of it; its episodes are."""
    spec, inspections = inspected(path)
    before = fingerprint_of(spec, inspections)
    data = pinned(tomllib.loads(path.read_text()), inspections)
    path.write_text(tomli_w.dumps(data))
    again, inspections = inspected(path)
    assert again.environments["line"].digest == inspections["line"].digest
    assert before == fingerprint_of(again, inspections)
    path.write_text(tomli_w.dumps({**data, "seeds": {"episodes": 3}}))
    assert before != fingerprint_of(*inspected(path))


def test_suite_refuses_what_it_does_not_pin(path: Path) -> None:
    """Unless one goes on all the same: then the results say so."""
    text = TEXT.replace('spec = "two_robot_line"', 'spec = "two_robot_line"\ndigest = "00"')
    path.write_text(text)
    with pytest.raises(SpecError, match="--unpinned"):
        evaluate(path)
    found = evaluate(path, unpinned=True)
    assert found.suite is not None
    assert any("digest 00 is pinned" in each for each in found.suite["unpinned"])
    assert "Not the suite as it was pinned" in found.notes[0]


def test_suite_refuses_another_policy_than_it_pins(path: Path) -> None:
    """A policy whose file has changed is another one."""
    path.write_text(TEXT.replace('policy = "random"', 'policy = "random"\ndigests = ["00"]'))
    with pytest.raises(SpecError, match="policy random"):
        evaluate(path)


def test_suite_results_carry_its_id_and_fingerprint(path: Path) -> None:
    """So that a script can cite them."""
    found = evaluate(path)
    assert found.suite is not None
    assert tuple(found.suite[k] for k in ("id", "version", "unpinned")) == ("small-1", "1", [])
    assert len(found.suite["fingerprint"]) == 32
    assert found.commands == (f"gamekeeper evaluate {path}",)
