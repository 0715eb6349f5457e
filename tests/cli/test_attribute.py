"""`gamekeeper attribute` on the command line."""

from pathlib import Path

import pytest

import gamekeeper as gk
from tests.cli.lines import LINE, document, said

FEW = ("--episodes", "2", "--action-episodes", "2")


@pytest.fixture
def line(tmp_path: Path) -> Path:
    """A recorded run of two robots on a line."""
    gk.rollout("two_robot_line", episodes=2, out=tmp_path / "run")
    return tmp_path / "run"


def test_attribute_shows_a_row_for_each_agent(
    line: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Nobody is averaged away, and what wasn't tested is said."""
    code, out, _ = said(capfd, "attribute", line, *FEW)
    assert code == 0
    rows = [row.split()[0] for row in out.splitlines() if row.startswith("  ")]
    assert {"picker", "carrier"} <= set(rows)
    assert "Not tested" in out


def test_attribute_document_has_the_fields_of_the_interface(
    line: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The fields that others read are there, with the baseline named."""
    code, found = document(capfd, "attribute", line, *FEW, "--baseline", "random")
    assert code == 0
    assert found["run"] == str(line)
    part = found["agents"]["picker"]
    assert part.keys() >= {"return", "share", "idle", "difference", "shapley", "lazy"}
    assert part["difference"]["baseline"] == "random"


@pytest.mark.usefixtures("nothing_is_ours")
def test_attribute_asks_before_it_runs_a_file(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A run that names a file of code is not played unasked, and the exit code is 2."""
    gk.rollout(LINE, episodes=1, out=tmp_path / "run")
    code, _, err = said(capfd, "attribute", tmp_path / "run", *FEW)
    assert code == 2
    assert "--allow-import" in err
