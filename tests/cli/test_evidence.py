import shutil
from pathlib import Path

import pytest

import gamekeeper as gk
from tests.cli.lines import LINE, document, said


def test_diff_of_equal_runs_is_the_same(
    line_run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A copy is the same: exit code 0, no divergence."""
    shutil.copytree(line_run, tmp_path / "copy")
    assert said(capfd, "diff", line_run, tmp_path / "copy")[:2] == (0, "the same\n")
    code, found = document(capfd, "diff", line_run, tmp_path / "copy")
    assert code == 0
    assert (found["equal"], found["divergence"]) == (True, None)


def test_diff_names_the_first_difference(
    line_run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Runs from other seeds can't be compared by turns: exit code 1, and both seeds."""
    gk.rollout(LINE, episodes=3, seed=1, out=tmp_path / "other")
    code, out, _ = said(capfd, "diff", line_run, tmp_path / "other")
    assert code == 1
    assert out.startswith("different set-up: the turns of these runs can't be compared\n")
    assert "episode 0: the seed of its reset\n" in out
    assert "the same environment, arguments and seeds" in out
    assert str(tmp_path / "other") in out
    code, found = document(capfd, "diff", line_run, tmp_path / "other")
    assert (code, found["equal"], found["divergence"]["field"]) == (1, False, "seed")
    assert (found["comparable"], len(found["set_up"])) == (False, 1)


def test_diff_of_other_environments_names_all_that_differs(
    line_run: Path, rough_run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The environments are named before the turns, which can't be compared; exit code 1."""
    code, out, _ = said(capfd, "diff", line_run, rough_run)
    assert code == 1
    lines = out.splitlines()
    assert lines[1] == "the name of the environment"
    assert "two_robot_line_v0" in lines[2]
    assert "rough_v0" in lines[3]
    assert "turn 0" not in out
    assert document(capfd, "diff", line_run, rough_run)[1]["divergence"]["field"] == (
        "environment.name"
    )


def test_verify_finds_a_changed_byte(
    line_run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A flipped bit is damage: exit code 1, and the file is named."""
    run = tmp_path / "copy"
    shutil.copytree(line_run, run)
    assert document(capfd, "verify", run)[1]["ok"]
    data = bytearray((run / "agent_steps.parquet").read_bytes())
    data[len(data) // 2] ^= 1
    (run / "agent_steps.parquet").write_bytes(data)
    code, found = document(capfd, "verify", run)
    assert code == 1
    assert found.keys() >= {"run", "ok", "self_consistent", "matches", "damage"}
    assert (found["ok"], found["matches"]) == (False, None)
    assert [each["file"] for each in found["damage"]] == ["agent_steps.parquet"]


def test_verify_compares_with_a_fingerprint(
    line_run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The fingerprint from elsewhere matches, or the exit code is 1."""
    fingerprint = gk.load(line_run).fingerprint
    code, found = document(capfd, "verify", line_run, "--fingerprint", fingerprint[:40])
    assert (code, found["matches"], found["ok"]) == (0, True, True)
    code, found = document(capfd, "verify", line_run, "--fingerprint", "0" * 64)
    assert (code, found["matches"], found["ok"]) == (1, False, False)


def test_verify_compares_with_a_root_digest(
    line_run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """It is the one that recording and showing the run print; another one: exit code 1."""
    code, shown = document(capfd, "show", line_run)
    code, found = document(capfd, "verify", line_run, "--root", shown["root"])
    assert (code, found["matches"], found["ok"], found["root"]) == (0, True, True, shown["root"])
    assert (found["not_checked"], found["strays"]) == (None, [])
    assert shown["root"] in said(capfd, "show", line_run)[1]
    assert said(capfd, "verify", line_run, "--root", "0" * 32)[0] == 1
    assert "not checked" in said(capfd, "verify", line_run)[1]
    assert "this is no root digest" in said(capfd, "verify", line_run, "--root", "0" * 31)[2]


@pytest.mark.parametrize("given", ["f6d28b", "", "f" * 65, "runs/demo", "x" * 64])
def test_verify_tells_what_is_no_fingerprint(
    line_run: Path, capfd: pytest.CaptureFixture[str], given: str
) -> None:
    """A fingerprint that was copied wrongly says nothing of the run: exit code 2."""
    code, _, err = said(capfd, "verify", line_run, "--fingerprint", given)
    assert code == 2
    assert "this is no fingerprint" in err


def test_verify_takes_a_fingerprint_as_run_shows_it(
    line_run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Cut, with dots after it, in capitals, with a space: it is the same one."""
    shown = f" {gk.load(line_run).fingerprint[:40].upper()}... "
    code, _, _ = said(capfd, "verify", line_run, "--fingerprint", shown)
    assert code == 0


def test_recover_leaves_a_finalized_run_alone(
    line_run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """There is nothing to recover in a run that was closed."""
    before = {path.name: path.read_bytes() for path in line_run.iterdir()}
    code, found = document(capfd, "recover", line_run)
    assert (code, found["status"], found["changed"]) == (0, "finalized", False)
    assert {path.name: path.read_bytes() for path in line_run.iterdir()} == before


def test_show_tells_what_a_run_is(line_run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Environment, status, seeds and every agent's part stand on the screen and in the document."""
    evidence = gk.load(line_run)
    code, out, _ = said(capfd, "show", line_run)
    assert code == 0
    for text in (
        "two_robot_line_v0 (parallel)",
        "two_robot_line.py:make",
        "finalized",
        "random",
        evidence.fingerprint[:50],
    ):
        assert text in out
    assert [line.split()[0] for line in out.splitlines()[-2:]] == ["picker", "carrier"]
    code, found = document(capfd, "show", line_run)
    assert (found["status"], found["seed"], found["level"]) == ("finalized", 0, "full")
    assert (found["ends"], found["errors"]) == ({"ended": 3}, [])
    assert found["environment"]["name"] == "two_robot_line_v0"
    assert found["agents"] == evidence.to_json()["agents"]


@pytest.mark.parametrize("command", ["show", "verify", "recover"])
def test_no_run_is_wrong_use(
    command: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A folder without evidence exits 2."""
    code, out, err = said(capfd, command, tmp_path)
    assert (code, out) == (2, "")
    assert err.startswith("RunError: ")


def test_show_tells_what_an_environment_is_made_of(capfd: pytest.CaptureFixture[str]) -> None:
    """Of a shipped environment: which wrappers one replaces, and whose the rules are."""
    code, found = document(capfd, "show", "classic/tictactoe-v3")
    assert code == 0
    assert [line.partition(" (")[0] for line in found["made_of"]] == [
        "replaced: OrderEnforcingWrapper",
        "replaced: AssertOutOfBoundsWrapper",
        "replaced: TerminateIllegalWrapper",
        "environment: pettingzoo.classic.tictactoe.tictactoe.raw_env",
    ]
