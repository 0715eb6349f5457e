"""`gamekeeper show RUN --against ENV`: what of the evidence still holds."""

import importlib
import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.cli import _worker
from gamekeeper.rollouts.workers import TaskOutcome
from tests.cli.lines import LINE, document, said
from tests.surface.sources import ROOT


@pytest.fixture
def env(tmp_path: Path) -> str:
    """A copy of the two robots on a line, which a test may change."""
    for suffix in ("py", "toml"):
        source = ROOT / "examples" / f"two_robot_line.{suffix}"
        if source.is_file():
            shutil.copy(source, tmp_path / f"line.{suffix}")
    return f"{tmp_path / 'line.py'}:make"


@pytest.fixture
def run(env: str, tmp_path: Path) -> Path:
    """Two episodes of it."""
    gk.rollout(env, episodes=2, out=tmp_path / "run")
    return tmp_path / "run"


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a worker would look at is looked at in this process: a worker takes a second."""

    def run_here(task: str, arguments: Any, *, silence_s: float) -> TaskOutcome:
        module, _, name = task.partition(":")
        run = getattr(importlib.import_module(module), name)
        return TaskOutcome("done", run(lambda **fields: None, **arguments), None, None, 0.0)

    monkeypatch.setattr(_worker, "run_task", run_here)


def status(rows: list[dict[str, Any]]) -> dict[str, str]:
    """The status of each row."""
    return {row["what"]: row["status"] for row in rows}


def test_against_holds_where_nothing_changed(
    run: Path, env: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Exit code 0, every row holds, nothing is to be done."""
    code, found = document(capfd, "show", run, "--against", env)
    assert (code, found["status"], found["holds"], found["commands"]) == (0, "holds", True, [])
    assert set(status(found["rows"]).values()) == {"holds"}
    told = status(found["rows"])
    for what in ("source", "kwargs", "spaces", "contract", "policy random", "version numpy"):
        assert what in told
    code, out, err = said(capfd, "show", run, "--against", env)
    assert (code, err) == (0, "")
    assert out.startswith("holds: its environment and policies are unchanged")
    assert max(map(len, out.splitlines())) <= 80


@pytest.mark.usefixtures("here")
def test_against_names_what_is_stale_and_how_to_measure_it(
    run: Path, env: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Another source: exit code 1, both digests, and the command that records it anew."""
    with (tmp_path / "line.py").open("a") as file:
        file.write("\n# another one\n")
    code, found = document(capfd, "show", run, "--against", env)
    assert (code, found["status"], found["holds"]) == (1, "stale", False)
    stale = [row for row in found["rows"] if row["status"] == "stale"]
    assert [row["what"] for row in stale] == ["source"]
    assert stale[0]["recorded"] != stale[0]["now"]
    again = f"--policy random --episodes 2 --seed 0 --out {run}-again"
    assert found["commands"] == [f"gamekeeper rollout {env} {again}"]
    code, out, _ = said(capfd, "show", run, "--against", env)
    assert code == 1
    assert out.startswith("stale: 1 of ")
    assert f"gamekeeper rollout {env}" in out


@pytest.mark.usefixtures("here")
def test_against_tells_arguments_and_another_game(
    run: Path, env: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Arguments are the recorded ones unless typed; another game is stale all over."""
    _, found = document(capfd, "show", run, "--against", "warehouse", "--kwargs", "{}")
    told = status(found["rows"])
    for what in ("name", "source", "spaces", "contract"):
        assert told[what] == "stale"
    spaces = next(row for row in found["rows"] if row["what"] == "spaces")
    assert spaces["now"] == "2 are missing: carrier, picker"
    assert [line.split()[1] for line in found["commands"]] == ["rollout", "audit"]


@pytest.mark.usefixtures("here")
def test_against_tells_a_contract_that_changed(
    run: Path, env: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """What was judged by it is stale, under the tables that differ; rollouts aren't."""
    contract = tmp_path / "other.toml"
    contract.write_text('name = "two_robot_line_v0"\nwhy = "another game"\n')
    code, found = document(capfd, "show", run, "--against", env, "--contract", contract)
    stale = [row for row in found["rows"] if row["status"] == "stale"]
    assert (code, [row["what"] for row in stale]) == (1, ["contract"])
    assert found["commands"] == [f"gamekeeper audit {env}"]


@pytest.mark.usefixtures("here")
def test_against_leaves_another_version_to_a_replay(
    run: Path, env: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Another NumPy may change nothing: exit code 2, and the replay that tells."""
    from tests.runs.finalize_again import finalize_again

    manifest = json.loads((run / "manifest.json").read_text())
    manifest["environment"]["versions"]["numpy"] = "1.0.0"
    finalize_again(run, environment=manifest["environment"])
    code, found = document(capfd, "show", run, "--against", env)
    assert (code, found["status"], found["holds"]) == (2, "unknown", None)
    assert found["commands"] == [f"gamekeeper replay {run} --env {env}"]
    assert "Unknown\n" in said(capfd, "show", run, "--against", env)[1]


@pytest.mark.usefixtures("here")
def test_against_runs_no_code_that_evidence_names(
    env: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A policy in a file is looked at only where that is allowed; then its source counts."""
    policy = tmp_path / "mine.py"
    policy.write_text(
        "from pathlib import Path\n"
        f"Path({str(tmp_path / 'ran')!r}).touch()\n"
        "def act(agent, observation, info, rng):\n    return 0\n"
    )
    gk.rollout(env, policies=f"{policy}:act", episodes=1, out=tmp_path / "run")
    (tmp_path / "ran").unlink()
    code, found = document(capfd, "show", tmp_path / "run", "--against", env)
    assert code == 2
    assert status(found["rows"])[f"policy {policy}:act"] == "unknown"
    assert not (tmp_path / "ran").exists()
    line = ["show", tmp_path / "run", "--against", env, "--allow-import"]
    assert document(capfd, *line)[0] == 0
    policy.write_text(policy.read_text().replace("return 0", "return 1"))
    code, found = document(capfd, *line)
    assert (code, status(found["rows"])[f"policy {policy}:act"]) == (1, "stale")
    assert f"--policy {policy}:act" in found["commands"][0]
    policy.unlink()
    code, found = document(capfd, *line)
    assert (code, status(found["rows"])[f"policy {policy}:act"]) == (1, "stale")


@pytest.mark.usefixtures("here")
def test_against_cant_tell_who_played_a_run_that_doesnt_say(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A run stepped by somebody else names no policies."""
    made: Any = gk.record(gk.make("two_robot_line"), tmp_path / "run")
    made.reset(seed=1)
    made.close()
    code, found = document(capfd, "show", tmp_path / "run", "--against", "two_robot_line")
    assert code == 2
    assert status(found["rows"])["policies"] == "unknown"


@pytest.mark.usefixtures("here")
def test_against_reads_evaluations(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Digests of its environments and policies, with the command that plays what is stale."""
    from gamekeeper.evaluation.evaluator import evaluate

    evaluate(
        "two_robot_line", policies={"dice": "random"}, episodes=2, out=tmp_path / "e", workers=0
    )
    code, found = document(capfd, "show", tmp_path / "e", "--against", "two_robot_line")
    assert (code, found["status"]) == (0, "holds")
    assert any(re.search("policy dice", row["what"]) for row in found["rows"])
    path = tmp_path / "e" / "evaluation.json"
    said_then = json.loads(path.read_text())
    next(iter(said_then["environments"].values()))["digest"] = "0" * 32
    path.write_text(json.dumps(said_then))
    code, found = document(capfd, "show", tmp_path / "e", "--against", "two_robot_line")
    assert (code, found["status"]) == (1, "stale")
    stale = next(row for row in found["rows"] if row["status"] == "stale")
    assert "every result in" in stale["again"]
    assert found["commands"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["nowhere", "--against", "two_robot_line"], "only a run or an evaluation"),
        (["RUN", "--against", "RUN"], "not with a run"),
        (["RUN", "--against", "no_such_environment"], "no_such_environment"),
        (["RUN", "--against", "two_robot_line", "--kwargs", "[1]"], "--kwargs can't be read"),
        (["RUN", "--against", "two_robot_line", "--kwargs", '{"wings": 2}'], "wings"),
    ],
)
@pytest.mark.usefixtures("here")
def test_against_refuses_what_makes_no_sense(
    words: list[str], told: str, line_run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2, the reason on stderr."""
    line = [str(line_run) if word == "RUN" else word for word in words]
    code, out, err = said(capfd, "show", *line)
    assert (code, out) == (2, "")
    assert told in err


@pytest.mark.usefixtures("here")
def test_against_is_the_environment_that_is_named(
    line_run: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The same rules under another name are the same source."""
    code, found = document(capfd, "show", line_run, "--against", f"parallel:{LINE}")
    assert (code, status(found["rows"])["source"]) == (0, "holds")
