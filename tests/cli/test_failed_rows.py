"""Rules that recorded rows break are said wherever the rows are made or read."""

from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.auditing.recorded_evidence import failed_rows, masked_actions
from gamekeeper.runs.load_run import load
from gamekeeper.viewing.report_file import report
from tests.auditing.sound_habits import Parts
from tests.cli.lines import LINE, document, said

SHRINKS = "tests.faults.spaces:Shrinking"


@pytest.fixture(autouse=True)
def _in_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    """The faulty environment is a module of the project."""
    monkeypatch.chdir(Path(__file__).parents[2])


def test_rows_that_miss_their_space_are_said(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """`rollout`, `replay` and `report` name the check; a sound run is left alone."""
    run, sound = tmp_path / "run", tmp_path / "sound"
    code, out, err = said(capfd, "rollout", SHRINKS, "--episodes", 5, "--out", run)
    assert code == 0, err
    assert "Rules that the recorded rows break\n  GK213  Should hold: " in out
    code, replayed = document(capfd, "replay", run, "--env", SHRINKS)
    assert (code, [each["id"] for each in replayed["verdicts"]]) == (0, ["GK213"])
    page = report(run, tmp_path / "report.html").read_text(encoding="utf-8")
    assert "GK213. Should hold: Every observation" in page

    code, recorded = document(capfd, "rollout", LINE, "--episodes", 1, "--out", sound)
    assert (code, recorded["verdicts"]) == (0, [])


def test_no_row_of_a_long_run_is_judged_beyond_its_bound(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whole episodes are judged as long as they fit."""
    run = tmp_path / "run"
    code, _, err = said(capfd, "rollout", SHRINKS, "--episodes", 5, "--out", run)
    assert code == 0, err
    monkeypatch.setattr("gamekeeper.auditing.recorded_evidence.MOST_ROWS", 3)
    assert failed_rows(load(run)) == ()


def test_actions_against_the_mask_are_counted(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A policy that minds no mask is told so, agent by agent; one that does isn't."""
    careless, careful = tmp_path / "careless", tmp_path / "careful"
    (tmp_path / "stubborn.py").write_text(STUBBORN, encoding="utf-8")
    policy = f"{tmp_path}/stubborn.py:last"
    code, out, err = said(
        capfd, "rollout", TICTACTOE, "--episodes", 3, "--policy", policy, "--out", careless
    )
    assert code == 0, err
    assert "Actions that their mask forbids (of the policies)\n  player_2  3 of 3" in out
    assert masked_actions(load(careless)) == {"player_2": (3, 3)}
    code, out, err = said(capfd, "rollout", TICTACTOE, "--episodes", 3, "--out", careful)
    assert (code, "their mask" in out) == (0, False), err


def test_masks_of_several_arrays_are_left_to_the_audit() -> None:
    """A MultiDiscrete action is masked by an array for each axis; such a rollout ends well."""
    assert masked_actions(gk.rollout(Parts, episodes=1)) == {}


TICTACTOE = "classic/tictactoe_v3"
STUBBORN = """
def last(observation, agent, info, rng):
    return 8
"""
