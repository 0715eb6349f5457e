import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import gamekeeper as gk
from gamekeeper.cli._worker import evidence_folder, name_of
from gamekeeper.runs.files.folder import free_beside
from tests.cli.lines import LINE, ROUGH, SURROUNDINGS, document, failing, rough, run_apart, said
from tests.cli.rough_env import has_turns

AGENT_FIELDS = ["return_mean", "length_mean", "share", "idle", "endings"]


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders that a command chooses by itself stay out of the project."""
    monkeypatch.chdir(tmp_path)


def test_document_has_the_fields_that_others_read(capfd: pytest.CaptureFixture[str]) -> None:
    """The document of a recording is the one of the public surface, and names the run."""
    code, found = document(capfd, "rollout", LINE, "--episodes", 2, "--out", "mine", "--seed", 7)
    assert code == 0
    fields = ["run", "episodes", "turns", "agent_steps", "seconds", "agents", "fingerprint"]
    assert found.keys() >= set(fields)
    assert found["run"] == "mine"
    assert (found["episodes"], found["status"]) == (2, "finalized")
    assert list(found["agents"]) == ["picker", "carrier"]
    assert list(found["agents"]["picker"]) == AGENT_FIELDS
    assert found["fingerprint"] == gk.load("mine").fingerprint
    assert gk.load("mine").manifest["seed"] == 7


def test_text_shows_each_agent_and_no_average(capfd: pytest.CaptureFixture[str]) -> None:
    """Without --json every agent has its row; the folder is the first free one."""
    code, out, _ = said(capfd, "rollout", *rough(length=2), "--episodes", 1, "--policy", "leg=noop")
    assert code == 2  # nothing is declared as the leg's noop
    code, out, err = said(
        capfd, "rollout", *rough(length=2), "--episodes", 1, "--policy", f"leg={ROUGH[:-5]}:ones"
    )
    assert code == 0, err
    assert "Recorded  1 episode, 2 ticks, 4 actions" in out
    assert [line.split()[0] for line in out.splitlines()[2:4]] == ["arm", "leg"]
    assert "Saved in  runs/rough_env-1" in out
    evidence = gk.load("runs/rough_env-1")
    policies = json.loads(evidence.episode_table["policies"][0].as_py())
    assert policies["arm"]["policy"] == "random"
    assert policies["leg"]["policy"].endswith("rough_env.py:ones")


@pytest.mark.parametrize(
    ("how", "seen"),
    [
        ("raise", "RuntimeError: the gripper is stuck"),
        ("panic", "PanicError: unreachable grip"),
        ("hang", "no sign of life for 5 s"),
        ("exit", "sys.exit(4)"),
        ("die", "exit code 3"),
        ("segfault", "killed by SIGSEGV"),
    ],
)
def test_environment_that_fails_leaves_finalized_evidence(
    how: str, seen: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Exit code 1, status failed, and the reason as text in the episode and in the document."""
    code, found = document(capfd, *failing(how, tmp_path / "run"))
    assert code == 1
    assert found["status"] == "failed"
    assert found["error"]["kind"] == "EnvError"
    assert seen in found["error"]["what"] + found["error"]["actual"]
    evidence = gk.load(tmp_path / "run")
    assert evidence.manifest["status"] == "failed"
    last = evidence.episode_table.to_pylist()[-1]
    assert last["end"] == "failed"
    assert seen in last["error"] or how == "exit"
    assert evidence.agent_steps.num_rows > 0
    if how in ("raise", "panic", "hang", "exit"):
        assert "_go_wrong" in last["error"]
    assert said(capfd, "verify", tmp_path / "run")[0] == 0


def test_environment_that_interrupts_itself_is_told(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A KeyboardInterrupt that nobody sent is the environment's: exit code 1, no fault of ours."""
    code, found = document(capfd, *failing("interrupt", tmp_path / "run"))
    assert (code, found["error"]["kind"]) == (1, "EnvError")
    assert "KeyboardInterrupt" in found["error"]["what"]
    assert "_go_wrong" in found["error"]["actual"]


def test_death_before_the_first_flush_is_told_by_show(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A run that has no episode to hold the reason of its end still names it."""
    (tmp_path / "timings-0").write_text("so that it dies at once")
    line = [*rough(how="die", after=str(tmp_path)), "--out", tmp_path / "run"]
    assert said(capfd, "rollout", *line)[0] == 1
    code, found = document(capfd, "show", tmp_path / "run")
    assert (code, found["status"]) == (0, "failed")
    assert "exit code 3" in found["errors"][-1]["error"]
    assert "exit code 3" in said(capfd, "show", tmp_path / "run")[1]


def test_full_disk_is_told_and_what_was_written_replays(tmp_path: Path) -> None:
    """Exit code 2; the run is finalized as far as it came; its end isn't put on the environment."""

    def small_disk() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))

    line = [*rough(length=400), "--episodes", 100, "--out", "run", "--json"]
    ended = run_apart("rollout", *line, cwd=tmp_path, preexec_fn=small_disk)
    assert ended.returncode == 2, ended.stderr
    error = json.loads(ended.stdout)["error"]
    assert (error["kind"], "ulimit -f" in error["fix"]) == ("RunError", True)
    evidence = gk.load(tmp_path / "run")
    assert evidence.manifest["status"] == "failed"
    last = evidence.episode_table.to_pylist()[-1]
    assert last["end"] != "failed"
    assert "too large" in last["error"]
    assert gk.replay(tmp_path / "run", allow_import=True).verified


@pytest.mark.parametrize(
    ("line", "kind", "said_"),
    [
        (["no/such/id-v0"], "SpecError", "no/such/id-v0"),
        (rough(how="init"), "SpecError", "no gripper is fitted"),
        ([ROUGH, "--kwargs", "[1]"], "GamekeeperError", "--kwargs"),
        ([ROUGH, "--kwargs", "{"], "GamekeeperError", "a JSON object"),
        ([ROUGH, "--options", "3"], "GamekeeperError", "--options"),
        ([ROUGH, "--policy", "nobody=random"], "PolicyError", "nobody"),
        ([ROUGH, "--policy", "no-such"], "PolicyError", "no-such"),
        ([ROUGH, "--policy", f"{ROUGH[:-5]}:nothing"], "PolicyError", "None"),
        ([ROUGH, "--contract", "missing.toml"], "ContractError", "missing.toml"),
    ],
)
def test_mistake_of_the_user_is_told_without_traceback(
    line: list[str], kind: str, said_: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Wrong use exits 2 with what, where and fix; never with a traceback of ours."""
    code, out, err = said(capfd, "rollout", *line, "--json")
    error = json.loads(out)["error"]
    assert (code, error["kind"]) == (2, kind)
    assert said_ in " ".join(error.values())
    assert f"{kind}: {error['what']}" in err
    assert "gamekeeper/cli" not in err


def test_policy_that_acts_illegally_is_named_with_its_place(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Episode, turn, agent, what was legal, and the folder of the steps before it."""
    (tmp_path / "late.py").write_text(
        "seen = []\ndef act(observation, agent, info, rng):\n"
        "    seen.append(agent)\n    return 9 if len(seen) == 3 else 1\n"
    )
    line = (*rough(length=2), "--episodes", 3, "--policy", "leg=late.py:act", "--out", "mine")
    code, found = document(capfd, "rollout", *line)
    error = found["error"]
    assert (code, error["kind"]) == (2, "ActionError")
    assert error["where"] == "episode 1, turn 0, agent leg"
    assert error["expected"].startswith("an action of Discrete(")
    assert error["expected"].endswith(": 0 to 2")
    assert "recorded in mine" in error["fix"]
    assert gk.load("mine").episode_table.num_rows == 2


def test_reference_of_a_foreign_environment_is_explained(capfd: pytest.CaptureFixture[str]) -> None:
    """It is the policy of our tasks; the fix names what works here."""
    code, found = document(capfd, "rollout", ROUGH, "--policy", "reference")
    assert code == 2
    assert found["error"]["what"] == "this environment brings no reference policy"
    assert "scripted policy of Gamekeeper's own tasks" in found["error"]["fix"]
    assert "use random" in found["error"]["fix"]


@pytest.mark.parametrize(
    ("name", "other"), [("mine", "mine-2"), ("mine-7", "mine-8"), ("a.b", "a.b-2")]
)
def test_taken_folder_names_a_free_one(name: str, other: str, tmp_path: Path) -> None:
    """Numbered on, over those that exist."""
    assert free_beside(tmp_path / name) == tmp_path / other
    (tmp_path / other).mkdir()
    stem, _, number = other.rpartition("-")
    assert free_beside(tmp_path / name) == tmp_path / f"{stem}-{int(number) + 1}"


def test_existing_folder_is_left_alone(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Nothing is recorded into a folder that holds something."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("four years")
    code, _, err = said(capfd, "rollout", LINE, "--out", "mine")
    assert code == 2
    assert "isn't empty" in err
    assert "such as mine-2" in err
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.txt"]


def test_folder_without_evidence_is_taken_away_again(tmp_path: Path) -> None:
    """A numbered folder that a failed start left empty doesn't stay."""
    with evidence_folder(None, spec=LINE) as folder:
        assert folder.is_dir()
    assert not folder.exists()


def test_folders_are_numbered(tmp_path: Path) -> None:
    """The next free number is taken at once, so two runs side by side never share a folder."""
    with evidence_folder(None, spec=LINE) as one, evidence_folder(None, spec=LINE) as two:
        assert [one.name, two.name] == ["two_robot_line-1", "two_robot_line-2"]


@pytest.mark.parametrize(
    ("spec", "name"),
    [
        ("butterfly/pistonball-v6", "pistonball-v6"),
        ("mpe2.simple_spread_v3:parallel_env", "simple_spread_v3"),
        ("aec:mpe2.simple_spread_v3:env", "simple_spread_v3"),
        ("path/to/two_robot_line.py:make", "two_robot_line"),
        ("parallel:./my env.py", "my_env"),
        ("src/my_task/env.py:MyTask", "my_task"),
        ("env.py", "env"),
        ("warehouse", "warehouse"),
        ("../..", "run"),
        ("", "run"),
    ],
)
def test_folder_is_named_after_the_environment(spec: str, name: str) -> None:
    """What a user typed gives a name that any folder can have."""
    assert name_of(spec) == name


@pytest.fixture
def slow_run(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A recording of an environment that takes 10 ms a tick and never ends by itself."""
    line = [*rough(length=10**9, tick_s=0.01), "--out", "run", "--json"]
    with subprocess.Popen(
        [sys.executable, "-m", "gamekeeper", "rollout", *line],
        cwd=tmp_path,
        env=SURROUNDINGS,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        yield process
        process.kill()


def wait_for_turns(run: Path, process: subprocess.Popen[str], *, most_s: float = 40.0) -> bool:
    """Whether whole turns have come to lie on the disk before `most_s` were over."""
    end_s = time.monotonic() + most_s
    while not has_turns(run) and time.monotonic() < end_s and process.poll() is None:
        time.sleep(0.02)
    return has_turns(run)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_recording_is_finalized(
    number: signal.Signals, slow_run: subprocess.Popen[str], tmp_path: Path
) -> None:
    """Ctrl-C, and a plain kill, checksums what was recorded and exit 130."""
    assert wait_for_turns(tmp_path / "run", slow_run)
    os.kill(slow_run.pid, number)
    out, err = slow_run.communicate(timeout=40)
    assert slow_run.returncode == 130, err
    found = json.loads(out)
    assert (found["status"], found["interrupted"]) == ("finalized", True)
    assert "interrupted" in err
    evidence = gk.load(tmp_path / "run")
    assert evidence.manifest["status"] == "finalized"
    assert evidence.episode_table["end"].to_pylist() == ["cut"]
    assert evidence.agent_steps.num_rows > 0
