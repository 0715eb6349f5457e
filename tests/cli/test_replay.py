import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.cli._screen import Screen
from gamekeeper.cli.replay import replay_code, show_replayed
from gamekeeper.episodes.divergence import Divergence
from gamekeeper.runs.comparison import Replay
from tests.cli.lines import LINE, ROUGH, document, said

FIELDS = ["run", "verified", "within_tolerance", "fingerprint", "divergence", "reason"]


def test_equal_replay_is_verified(line_run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A run that comes out bit for bit says so with its fingerprint, and exits 0."""
    code, out, _ = said(capfd, "replay", line_run, "--env", LINE)
    assert (code, out) == (0, f"verified: fingerprint {gk.load(line_run).fingerprint}\n")


@pytest.fixture
def _a_known_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    """Looking for a cause replays four times more; here it is known."""
    monkeypatch.setattr("gamekeeper.runs.comparison.cause_of", lambda *_, **__: "the drift is on")


@pytest.mark.usefixtures("_a_known_cause")
def test_other_environment_diverges(
    rough_run: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The first field that differs is named with both values, and the exit code is 1."""
    monkeypatch.setenv("ROUGH_DRIFT", "0.5")
    code, found = document(capfd, "replay", rough_run, "--allow-import")
    assert code == 1
    assert found.keys() >= set(FIELDS)
    assert (found["verified"], found["reason"]) == (False, None)
    place = {key: found["divergence"][key] for key in ("episode", "turn", "agent", "field")}
    assert place == {"episode": 0, "turn": 0, "agent": "arm", "field": "obs"}
    assert found["divergence"].keys() >= {"recorded", "replayed"}


def test_divergence_is_shown_with_its_cause(capfd: pytest.CaptureFixture[str]) -> None:
    """Place, both values, cause and differing versions stand under one another, indented."""
    divergence = Divergence(3, 7, "arm", "reward", 1.0, 0.5)
    replayed = Replay(
        run="x",
        verified=False,
        within_tolerance=None,
        fingerprint="f",
        divergence=divergence,
        versions={"numpy": ["2.0.0", "2.4.6"]},
        cause="the environment changed",
    )
    show_replayed(Screen(sys.stdout), replayed, indent="  ")
    assert capfd.readouterr().out.splitlines() == [
        "  diverged at episode 3, turn 7, agent arm: reward",
        "    recorded  1.0",
        "    replayed  0.5",
        "  Cause",
        "    the environment changed",
        "  Versions that differ",
        "    numpy  2.0.0 when recorded, 2.4.6 now",
    ]
    assert replay_code(replayed) == 1


def test_small_difference_is_within_tolerance(
    rough_run: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Numbers that differ by no more than --tolerance are accepted, and that is said."""
    monkeypatch.setenv("ROUGH_DRIFT", "1e-9")
    code, out, _ = said(capfd, "replay", rough_run, "--allow-import", "--tolerance", "1e-6")
    assert code == 0
    assert out.startswith("within tolerance")


@pytest.mark.usefixtures("nothing_is_ours")
def test_code_outside_the_installation_needs_leave(
    rough_run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A file that evidence names is not run unasked."""
    code, found = document(capfd, "replay", rough_run)
    assert code == 2
    assert found["error"]["kind"] == "TrustError"
    assert "--allow-import" in found["error"]["fix"]


def test_missing_environment_cannot_be_told(
    rough_run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Where nothing can be replayed, the exit code is 2 and the reason is given."""
    code, found = document(capfd, "replay", rough_run, "--env", "gone.py:make")
    assert (code, found["verified"], found["divergence"]) == (2, False, None)
    assert "gone.py" in found["reason"]


def test_policies_choose_again(rough_run: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """With --policies the recorded policies decide, and come to the same."""
    code, found = document(capfd, "replay", rough_run, "--policies", "--env", ROUGH)
    assert (code, found["verified"]) == (0, True)


def test_own_policies_of_a_trusted_environment_choose_again(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """`reference` of a task that is installed is as trusted as the task: nobody is asked."""
    gk.rollout("two_robot_line", policies="reference", episodes=1, out=tmp_path / "run")
    code, found = document(capfd, "replay", tmp_path / "run", "--policies")
    assert (code, found.get("verified")) == (0, True)


@pytest.mark.parametrize("run", ["nowhere", "."])
def test_no_run_is_wrong_use(
    run: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A folder without evidence is an error of its own, told without a traceback."""
    monkeypatch.chdir(tmp_path)
    code, out, err = said(capfd, "replay", run)
    assert (code, out) == (2, "")
    assert err.startswith("RunError: ")


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"verified": True}, 0),
        ({"within_tolerance": True}, 0),
        ({"reason": "the environment was an object in memory"}, 2),
    ],
)
def test_exit_code_says_what_came_out(fields: Mapping[str, Any], code: int) -> None:
    """0 the same, 2 nobody can tell; 1 is seen where a replay diverges."""
    blank = {"verified": False, "within_tolerance": None, "divergence": None}
    assert replay_code(Replay(run="x", fingerprint="f", **{**blank, **fields})) == code


def test_verified_replay_says_which_source_differs(capfd: pytest.CaptureFixture[str]) -> None:
    """Another file that plays the same is no divergence, and isn't hidden."""
    replayed = Replay(
        run="x",
        verified=True,
        within_tolerance=None,
        fingerprint="f",
        divergence=None,
        versions={"source": ["aa", "bb"]},
    )
    show_replayed(Screen(sys.stdout), replayed)
    assert capfd.readouterr().out.splitlines() == [
        "verified: fingerprint f",
        "Versions that differ",
        "  source  aa when recorded, bb now",
        "(every turn is equal nevertheless)",
    ]


def test_source_that_differs_is_in_the_document_of_a_verified_replay(
    line_run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A copy of the environment with one more comment plays the same, and is another source."""
    original = Path(LINE.rpartition(":")[0])
    copy = tmp_path / original.name
    copy.write_text(original.read_text(encoding="utf-8") + "# one more\n", encoding="utf-8")
    code, found = document(capfd, "replay", line_run, "--env", f"{copy}:make")
    assert (code, found["verified"], list(found["versions"])) == (0, True, ["source"])
