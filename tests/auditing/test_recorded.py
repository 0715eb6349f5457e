"""Recorded runs are judged row by row, and nothing of them is executed."""

from __future__ import annotations

from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.errors import EvidenceError
from tests.faults import environments


def recorded(name: str, out: Path, **options: object) -> str:
    """A run of a faulty environment."""
    gk.rollout(environments()[name].spec, episodes=40, seed=0, out=str(out), **options)
    return str(out)


@pytest.mark.parametrize("name", ["Rovers", "Traders"])
def test_sound_run_passes_and_names_what_needs_reruns(name: str, tmp_path: Path) -> None:
    """Checks of rows pass; the others weren't exercised, and say what exercises them."""
    found = gk.audit(recorded(name, tmp_path / "run"))
    assert found.failed == ()
    assert found.ok
    assert found.of("GK214").outcome == "passed"
    assert found.of("GK604").outcome == "not_exercised"
    assert "gamekeeper audit ENV" in found.of("GK604").reason


@pytest.mark.parametrize("id", ["GK214", "GK215", "GK401", "GK402"])
def test_run_fails_what_its_environment_fails(id: str, tmp_path: Path) -> None:
    """What one row decides fails in the evidence too, at a place in the run."""
    names = [name for name, each in environments().items() if id in each.checks]
    outcomes = []
    for name in names:
        verdict = gk.audit(recorded(name, tmp_path / name), select=(id,)).of(id)
        outcomes.append(verdict.outcome)
        if verdict.outcome == "failed":
            assert verdict.findings[0].where.startswith("episode ")
            assert verdict.reproduced is None
    assert "failed" in outcomes


def test_environment_of_a_run_is_not_opened(tmp_path: Path) -> None:
    """The file with the environment is gone, and its run is judged all the same."""
    file = tmp_path / "mine.py"
    file.write_text("from tests.faults.rovers import Rovers as make\n")
    gk.rollout(f"{file}:make", episodes=2, out=str(tmp_path / "run"))
    file.unlink()
    assert gk.audit(tmp_path / "run").of("GK214").outcome == "passed"


def test_run_of_digests_is_refused_with_the_way_out(tmp_path: Path) -> None:
    """Observations that aren't kept can't be judged."""
    run = recorded("Rovers", tmp_path / "run", level="digest")
    with pytest.raises(EvidenceError, match="--level full"):
        gk.audit(run)
