"""Environments that misbehave: what is kept of them, and what they can't take with them."""

import json
import os
import shutil
import signal
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.errors import EnvError
from gamekeeper.interface.opening import open_env
from gamekeeper.runs.comparison import replay_evidence
from tests.cli.lines import run_apart
from tests.runs.wild_env import WildTicks, WildTurns

KINDS = [WildTicks, WildTurns]
FILE = Path(__file__).with_name("wild_env.py")


def wild(folder: Path, *line: object, at: str, how: str, **settings: Any) -> Any:
    """What a command made of an environment that misbehaves so, in a process of its own.

    Its file lies in `folder`, so that it may do to it what it likes.
    """
    shutil.copy(FILE, folder / "wild_env.py")
    kwargs = json.dumps({"at": at, "how": how, **settings})
    command, *rest = line
    words = [command, "wild_env.py:turns", "--kwargs", kwargs, "--json", *rest]
    done = run_apart(*words, cwd=folder)
    assert "Traceback" not in done.stdout
    return done, json.loads(done.stdout, parse_constant=pytest.fail)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("how", ["raise", "exit"])
@pytest.mark.parametrize(
    ("at", "turn"),
    [
        ("reset", 0),
        ("step", 2),
        ("observe", 2),
        ("observe", 0),
        ("state", 2),
        ("state", 0),
        ("render", 2),
        ("render", 0),
        ("space", 2),
        ("space", 0),
    ],
)
def test_environment_that_raises_is_kept_up_to_there(
    kind: Any, at: str, turn: int, how: str, tmp_path: Path
) -> None:
    """Whichever call raises, the run is finalized with the reason, opens, and replays as it was."""
    env = kind(at=at, how=how, turn=turn, render_mode="rgb_array")
    fails = True
    try:
        gk.rollout(env, episodes=2, out=tmp_path / "run", frames=True, seed=1)
        fails = False
    except EnvError:
        assert at in ("reset", "step", "observe")
    evidence = gk.load(tmp_path / "run")
    ends = evidence.episode_table["end"].to_pylist()
    if fails:
        assert (evidence.manifest["status"], ends) == ("failed", ["failed"])
        assert "wild_env.py" in evidence.episode_table["error"][0].as_py()
    else:  # a state, a frame or a space that fails costs no more than itself
        assert at in ("state", "render", "space")
        assert (evidence.manifest["status"], ends) == ("finalized", ["ended", "ended"])
    again = kind(at=at, how=how, turn=turn, render_mode="rgb_array")
    replayed = replay_evidence(evidence, open_env(again))
    assert replayed.divergence is None
    assert replayed.verified


@pytest.mark.parametrize("kind", KINDS)
def test_environment_that_fails_to_be_looked_at_fails_its_episode(
    kind: Any, tmp_path: Path
) -> None:
    """Who steps a recorded environment and gets an exception has it in the evidence."""
    env = gk.record(kind(at="observe", how="raise", turn=0), tmp_path / "run")

    def look() -> None:
        env.reset(seed=1)
        env.last()  # a Parallel environment has raised by now

    with pytest.raises(RuntimeError, match="wild error"):
        look()
    env.close()
    row = gk.load(tmp_path / "run").episode_table.to_pylist()[0]
    assert (row["end"], row["error"].strip().endswith("wild error")) == ("failed", True)


@pytest.mark.parametrize("kind", KINDS)
def test_run_is_finalized_before_its_environment_is_closed(kind: Any, tmp_path: Path) -> None:
    """What is lost with the process at `close` (a graphics driver) is not the evidence."""
    seen: list[str] = []

    class Closing(kind):  # type: ignore[misc]
        def close(self) -> None:
            seen.append(json.loads((tmp_path / "run" / "manifest.json").read_text())["status"])

    gk.rollout(Closing(), episodes=2, out=tmp_path / "run")
    assert seen == ["finalized"]
    shutil.rmtree(tmp_path / "run")
    env = gk.record(Closing(), tmp_path / "run")
    env.reset(seed=1)
    env.close()
    assert seen == ["finalized", "finalized"]


@pytest.mark.parametrize("how", ["_exit0", "hang"])
def test_end_of_the_process_at_close_loses_no_row(how: str, tmp_path: Path) -> None:
    """Exit code 1 and the reason; the run is finalized with every episode."""
    patience = ["--timeout", 6] if how == "hang" else []
    line = ["rollout", "--episodes", 2, "--out", "run", *patience]
    done, found = wild(tmp_path, *line, at="close", how=how)
    assert done.returncode == 1, done.stderr
    assert (found["status"], found["episodes"]) == ("finalized", 2)
    assert found["error"]["kind"] == "EnvError"


def test_environment_that_meddles_is_recorded_all_the_same(tmp_path: Path) -> None:
    """Threads, programs and forks end with it; signals, folder and file aren't ours to miss."""
    line = ["rollout", "--episodes", 1, "--out", "run"]
    done, found = wild(tmp_path, *line, at="reset", how="meddle")
    assert (done.returncode, found["status"], found["episodes"]) == (0, "finalized", 1), done.stderr
    assert gk.load(tmp_path / "run").agent_steps.num_rows > 0
    assert found["seconds"] < 60  # what it started sleeps for a minute
    assert not (tmp_path / "wild_env.py").exists()
    assert not _left_behind(tmp_path)


def test_environment_that_closes_descriptors_is_told(tmp_path: Path) -> None:
    """Ours among them: exit code 1, and what was written opens."""
    line = ["rollout", "--episodes", 2, "--out", "run"]
    done, found = wild(tmp_path, *line, at="step", how="close")
    assert (done.returncode, found["error"]["kind"]) == (1, "EnvError"), done.stderr
    assert gk.load(tmp_path / "run").manifest["status"] in ("finalized", "failed")


def test_leak_ends_at_the_limit_of_memory(tmp_path: Path) -> None:
    """With --memory a leak is a MemoryError of the environment, and no one else's."""
    line = ["rollout", "--out", "run", "--memory", 900]
    done, found = wild(tmp_path, *line, at="step", how="leak", turn=5)
    assert (done.returncode, found["status"]) == (1, "failed"), done.stderr
    assert "MemoryError" in found["error"]["what"]


def _left_behind(folder: Path) -> list[int]:
    """Processes that still work in `folder`."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if (entry / "cwd").readlink() == folder:
                found.append(int(entry.name))
        except OSError:
            continue
    for number in found:
        os.kill(number, signal.SIGKILL)
    return found
