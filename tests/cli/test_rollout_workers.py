import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.randomness.seeds import episode_seed
from tests.cli.lines import LINE, SURROUNDINGS, document, run_apart, said
from tests.runs.parts.here import CROWD


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders that a command chooses by itself stay out of the project."""
    monkeypatch.chdir(tmp_path)


def test_workers_record_what_one_process_records(capfd: pytest.CaptureFixture[str]) -> None:
    """The document is the same but for folder, seconds and bytes, and nothing else is left."""
    line = ["rollout", LINE, "--episodes", 3, "--seed", 2]
    _, one = document(capfd, *line, "--out", "one")
    code, two = document(capfd, *line, "--out", "two", "--workers", 2)
    assert code == 0
    for found in (one, two):
        del found["run"], found["seconds"], found["root"]  # which covers the timings
    assert one == two
    assert sorted(path.name for path in Path().iterdir()) == ["one", "two"]
    place = (Path.cwd() / "far").as_uri()
    code, three = document(capfd, *line, "--storage", place)
    assert (code, three["run"], three["fingerprint"]) == (
        0,
        "runs/two_robot_line-1",
        one["fingerprint"],
    )


def test_failure_is_told_as_by_one_process(capfd: pytest.CaptureFixture[str]) -> None:
    """Exit code 1, status failed, the error in the document; the evidence is kept."""
    kwargs = json.dumps({"fails": [episode_seed(0, 1)]})
    code, found = document(
        capfd, "rollout", CROWD, "--kwargs", kwargs, "--episodes", 3, "--workers", 1, "--out", "run"
    )
    assert (code, found["status"], found["episodes"]) == (1, "failed", 2)
    assert "the crowd is stuck" in found["error"]["what"]
    assert said(capfd, "verify", "run")[0] == 0


def test_interrupted_recording_goes_on_with_the_same_command(tmp_path: Path) -> None:
    """Ctrl-C exits with 130 and says where the parts are; the same line plays only the rest."""
    (tmp_path / "waits").write_text(str(episode_seed(0, 2)))
    kwargs = json.dumps({"waits": str(tmp_path / "waits")})
    line = ["rollout", CROWD, "--kwargs", kwargs, "--episodes", "4", "--workers", "2"]
    began = subprocess.Popen(
        [sys.executable, "-m", "gamekeeper", *line],
        env=SURROUNDINGS,
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
    )
    parts = tmp_path / "runs" / "crowd-1-parts" / "parts"
    deadline_s = time.monotonic() + 50
    while len(list(parts.glob("*.json"))) < 3 and time.monotonic() < deadline_s:
        time.sleep(0.02)
    began.send_signal(signal.SIGINT)
    _, err = began.communicate(timeout=30)
    assert began.returncode == 130, err
    assert "no run was written; the episodes played until now stay in" in err
    assert "the same command continues" in err
    assert "crowd-1-parts" in err
    other = run_apart(*line, "--seed", 5, "--out", "runs/crowd-1", cwd=tmp_path)
    assert other.returncode == 2
    assert "another recording" in other.stderr
    (tmp_path / "waits").write_text("")
    ended = run_apart(*line, "--json", cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert "3 of 4 ranges of episodes were there already" in ended.stderr
    assert not parts.exists()
    found = json.loads(ended.stdout)
    assert found["run"] == "runs/crowd-1"
    one = gk.rollout(CROWD, episodes=4, env_kwargs={"waits": str(tmp_path / "waits")})
    assert one.fingerprint == found["fingerprint"]


@pytest.mark.parametrize(
    ("line", "seen"),
    [
        (["--workers", "0"], "--workers"),
        (["--executor", "dask"], "dask"),
        (["--storage", "nosuch://x"], "nosuch"),
    ],
)
def test_workers_that_there_are_not_are_told(
    line: list[str], seen: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Wrong use exits with 2 before anything is played, and leaves nothing behind."""
    code, _, err = said(capfd, "rollout", LINE, *line)
    assert code == 2
    assert seen in err
    assert not any(Path().glob("runs/*"))
