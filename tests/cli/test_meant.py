"""What was meant is named: runs, policies, forms and contracts that were typed a little wrong."""

from pathlib import Path

import pytest

import gamekeeper as gk
from tests.cli.lines import ROUGH, document, said


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one run and a file in it."""
    folder = tmp_path_factory.mktemp("meant") / "runs"
    gk.rollout("handover", episodes=1, seed=1, out=folder / "one-1")
    (folder / "notes.txt").write_text("nothing")
    return folder


@pytest.mark.parametrize("command", ["verify", "show", "replay"])
@pytest.mark.parametrize(
    ("name", "seen", "fix"),
    [
        ("one-2", "no such folder", "the nearest run there is"),
        ("", "a folder without manifest.json", "'one-1'"),
    ],
)
def test_run_that_is_not_there_has_its_neighbours_named(
    command: str, name: str, seen: str, fix: str, runs: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A misspelt run, and the folder that runs lie in; `show`, which takes environments, too."""
    code, told = document(capfd, command, runs / name)
    assert code == 2
    assert told["error"]["what"] == "there is no run here"
    assert told["error"]["actual"] == seen
    assert fix in told["error"]["fix"]


def test_file_in_place_of_a_run_is_called_a_file(
    runs: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Not: no such folder."""
    code, told = document(capfd, "verify", runs / "notes.txt")
    assert (code, told["error"]["actual"]) == (2, "a file")


def test_folder_of_many_runs_names_some(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The others are counted."""
    for number in range(8):
        (tmp_path / f"r{number}").mkdir()
        (tmp_path / f"r{number}" / "manifest.json").touch()
    _, told = document(capfd, "verify", tmp_path)
    assert told["error"]["fix"].endswith("'r0', 'r1', 'r2', 'r3', 'r4' and 3 more")


def test_run_refuses_an_unknown_policy_before_the_audit(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """And names the environment's own among those that there are."""
    out = tmp_path / "run"
    code, told = document(capfd, "run", "warehouse", "--policy", "refrence", "--out", out)
    assert code == 2
    assert told["error"]["fix"] == "did you mean reference?"
    assert "reference" in told["error"]["expected"]
    assert not out.exists()


@pytest.mark.parametrize("wrong", ["pickr=random", "tests.nothing:here", "picker_0=same:nobody"])
def test_run_refuses_whatever_cannot_play_before_the_audit(
    wrong: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A role misspelt, a module that isn't there, an object that nobody has: no audit begins."""
    monkeypatch.setattr("gamekeeper.cli.run.audit_with_progress", pytest.fail)
    code, told = document(capfd, "run", "warehouse", "--policy", wrong, "--out", tmp_path / "run")
    assert (code, told["error"]["kind"]) == (2, "PolicyError")


def test_a_misspelt_policy_is_refused_where_it_changes_nothing(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """An audit chooses for itself, and says so before it begins rather than go on for minutes."""
    monkeypatch.setattr("gamekeeper.cli.audit.audit_with_progress", pytest.fail)
    code, told = document(capfd, "audit", "warehouse", "--policy", "refrence")
    assert code == 2
    assert told["error"]["fix"] == "did you mean reference?"


@pytest.mark.parametrize("command", ["contract", "run", "rollout"])
def test_run_in_place_of_an_environment_is_told(
    command: str, runs: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Evidence can't be played; what reads it is named. A path of any form is looked at."""
    code, told = document(capfd, command, runs / "one-1")
    assert code == 2
    assert told["error"]["what"] == "this is a recorded run, and an environment is asked for"
    assert "gamekeeper show" in told["error"]["fix"]


@pytest.mark.parametrize("command", ["contract", "audit", "run", "show"])
def test_contract_in_place_of_an_environment_is_told(
    command: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its option is named, rather than a module of that name looked for."""
    code, told = document(capfd, command, "cards.toml")
    assert code == 2
    assert told["error"]["what"] == "a contract alone is no environment"
    assert "--contract cards.toml" in told["error"]["fix"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("list", "chekcs"), "'chekcs' is not one of"),
        (("export", "RUN", "--to", "numpi", "--out", "x"), "write 'numpy'"),
        (("evaluate", "two_robot_line"), "--policy reference --policy random"),
        (("label", "RUN"), "gamekeeper label RUN LABEL"),
    ],
)
def test_message_says_what_to_type(
    words: tuple[str, ...], told: str, runs: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The next try needs no page of the documentation."""
    _, out, err = said(capfd, *(runs / "one-1" if word == "RUN" else word for word in words))
    assert told in out + err
    assert "Value error" not in err


def test_help_tells_each_command_whole(capfd: pytest.CaptureFixture[str]) -> None:
    """What doesn't fit beside a command's name continues in the next line, and is never cut."""
    _, out, _ = said(capfd, "--help")
    listed = out.partition("Begin:")[2].partition("Example:")[0]
    assert [
        line for line in listed.splitlines() if line in ("Environments:", "Runs:", "View:")
    ] == ["Environments:", "Runs:", "View:"]
    assert [line for line in listed.splitlines() if line.endswith("...")] == []


def test_show_names_the_file_that_rules_stand_in(capfd: pytest.CaptureFixture[str]) -> None:
    """Not the name under which the file was loaded."""
    code, out, _ = said(capfd, "show", ROUGH)
    assert code == 0
    assert "environment: rough_env." in out
