import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.result import AuditResult
from gamekeeper.cli._form import GameForm
from gamekeeper.cli.run import contract_file, is_near
from gamekeeper.contract import Contract
from gamekeeper.errors import EnvError
from tests.cli.lines import LINE, failing, said

PAID = "tests.faults.rewards:PaidAfterEnd"
SMALL: Any = {"select": ("GK402",), "budget": 1_000}


@pytest.fixture(autouse=True)
def _small_audits_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """One check in this process: what is tested is what `run` makes of an audit."""

    def audited(screen: Any, spec: str, **options: Any) -> AuditResult:
        assert options["quick"]
        assert "seconds" not in options
        return audit_here(spec, env_kwargs=options["env_kwargs"], **SMALL)

    monkeypatch.setattr("gamekeeper.cli.run.audit_with_progress", audited)


def test_run_does_the_main_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Card, audit, recording, replay, each agent's part, evidence, a report next; 80 columns."""
    monkeypatch.chdir(tmp_path)
    code, out, err = said(capfd, "run", LINE, "--out", "demo", "--episodes", "2")
    assert code == 0, err
    fingerprint = gk.load("demo").fingerprint
    lines = out.splitlines()
    headings = [line.split("  ")[0] for line in lines if line and line[0] != " "]
    assert headings == [
        "two_robot_line_v0 (Parallel)",
        "Agents",
        "Rewards",
        "Endings",
        "Audited",
        "Recorded",
        "Replayed in a new process",
        "Saved in",
        "Next",
    ]
    assert f"  verified: fingerprint {fingerprint[:16]}..." in lines
    assert f"  fingerprint  {fingerprint}" in lines
    next_command = lines[-1].removeprefix("Next").split()
    assert next_command[:4] == ["gamekeeper", "report", "demo", "--open"]
    assert max(len(each) for each in lines[:-1] if fingerprint not in each) <= 80
    assert len(lines) <= 37


def test_run_document_has_the_parts_of_its_commands(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The documents of contract, audit, rollout and replay stand in one."""
    code, out, _ = said(capfd, "run", LINE, "--out", tmp_path / "demo", "--episodes", "1", "--json")
    found = json.loads(out)
    assert code == 0
    assert found["rollout"]["run"] == str(tmp_path / "demo")
    assert list(found) == ["contract", "audit", "rollout", "replay"]
    assert (found["audit"]["api"], found["audit"]["ok"]) == ("parallel", True)
    assert found["replay"]["verified"]
    assert found["rollout"]["fingerprint"] == found["replay"]["fingerprint"]


@pytest.mark.parametrize("command", ["run", "rollout"])
def test_folder_that_holds_something_is_refused_at_once(
    command: str, line_run: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Earlier evidence stays, nothing is opened or audited, and the fix names a free folder."""
    before = {path.name: path.read_bytes() for path in line_run.iterdir()}
    for name in ("look_at", "audit_with_progress", "record_in_worker"):
        monkeypatch.setattr(f"gamekeeper.cli.{command}.{name}", None, raising=False)
    code, out, err = said(capfd, command, LINE, "--out", line_run, "--episodes", "1", "--json")
    error = json.loads(out)["error"]
    assert (code, error["kind"]) == (2, "RunError")
    assert f"{line_run}-2" in error["fix"]
    assert "a run is there already" in err
    assert {path.name: path.read_bytes() for path in line_run.iterdir()} == before
    assert not line_run.with_name(f"{line_run.name}-2").exists()


@pytest.mark.parametrize(
    ("where", "seen"),
    [
        ("look_at", "interrupted before the recording: no run was written"),
        ("audit_with_progress", "interrupted in the audit: no run was written"),
        ("record_in_worker", "interrupted before the first step: no run was written"),
        ("replay_here", "interrupted in the replay: the run in demo is complete"),
    ],
)
def test_interrupt_says_if_a_run_is_on_the_disk(
    where: str,
    seen: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Ctrl-C in any part of `run` names the folder of the run, or says that there is none."""
    monkeypatch.chdir(tmp_path)

    def interrupted(*_: Any, **__: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(f"gamekeeper.cli.run.{where}", interrupted)
    code, _, err = said(capfd, "run", LINE, "--out", "demo", "--episodes", "1")
    assert code == 130
    assert seen in err
    assert (tmp_path / "demo").exists() == ("no run" not in seen)


def test_run_of_a_failing_environment_exits_1(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The turns until then are shown and finalized; there is no replay, and it isn't green."""
    line = [*failing("raise", tmp_path / "run")[1:], "--no-audit"]
    code, out, err = said(capfd, "run", *line)
    assert code == 1
    assert "the gripper is stuck" in err
    assert "Recorded  1 episode" in out
    assert "verified" not in out
    assert f"gamekeeper show {tmp_path / 'run'}" in out


def test_run_records_what_breaks_a_promise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """What is broken is shown in a few lines with the command for all of it; exit code 1."""
    monkeypatch.chdir(tmp_path)
    code, out, err = said(capfd, "run", PAID, "--out", "demo", "--episodes", "1")
    assert code == 1, err
    assert "Audited  " in out
    assert "GK402  high  Should hold: An agent that has ended is paid nothing more." in out
    assert f"To see all findings with their programs:\n    gamekeeper audit {PAID}" in out
    assert f"Next      gamekeeper audit {PAID}" in out.splitlines()[-1]
    assert "verified: fingerprint" in out


def test_run_names_checks_that_were_not_exercised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A count alone tells nothing: their ids, and the command that tells why."""

    def audited(screen: Any, spec: str, **options: Any) -> AuditResult:
        return audit_here(spec, select=("GK402", "GK526"), budget=200)

    monkeypatch.setattr("gamekeeper.cli.run.audit_with_progress", audited)
    code, out, err = said(capfd, "run", LINE, "--out", tmp_path / "a", "--episodes", "1")
    assert code == 0, err
    assert "1 not exercised" in out
    assert "not exercised, as nothing happened for them to check: GK526" in out
    assert f"To see why checks were not exercised:\n    gamekeeper audit {LINE}" in out


def test_run_counts_what_is_not_declared_and_names_the_command(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The command that drafts a contract is whole: environment, and the file that is found."""
    env = "tests.cli.rough_env:make"
    kwargs = '{"length": 2}'
    line = ("run", env, "--kwargs", kwargs, "--no-audit", "--episodes", "1")
    code, out, err = said(capfd, *line, "--out", tmp_path / "a")
    assert code == 0, err
    assert "properties are not declared, and so not checked. To see which:" in out
    assert f"    gamekeeper contract {env} --kwargs '{kwargs}' --out rough_v0.toml" in out


@pytest.mark.parametrize(
    ("env", "unit"), [("parallel:two_robot_line", "tick"), ("warehouse_turns", "turn")]
)
def test_run_counts_ticks_of_parallel_and_turns_of_aec(
    env: str, unit: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """One word for one step of the API."""
    line = (env, "--out", tmp_path / "a", "--episodes", "1", "--most-turns", "1")
    code, out, err = said(capfd, "rollout", *line)
    assert code == 0, err
    assert f"Recorded  1 episode, 1 {unit}, " in out


def test_run_goes_on_where_the_audit_gives_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Recording keeps evidence of what made the audit give up."""

    def give_up(*_: Any, **__: Any) -> Any:
        raise EnvError("the environment's process ended again and again")

    monkeypatch.setattr("gamekeeper.cli.run.audit_with_progress", give_up)
    code, out, err = said(capfd, "run", LINE, "--out", tmp_path / "a", "--episodes", "1", "--json")
    assert code == 0
    assert "again and again" in err
    assert json.loads(out)["audit"]["error"]["kind"] == "EnvError"


def test_run_without_an_audit_records_at_once(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """--no-audit leaves it out, of the document too."""
    line = ("run", LINE, "--out", tmp_path / "a", "--episodes", "1", "--no-audit", "--json")
    code, out, _ = said(capfd, *line)
    assert code == 0
    assert json.loads(out)["audit"] is None


def test_run_says_how_many_episodes_were_cut(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """An environment that doesn't end is cut, and the summary says where."""
    line = ("run", LINE, "--out", tmp_path / "a", "--episodes", "2", "--no-audit")
    code, out, _ = said(capfd, *line, "--most-turns", "1")
    assert code == 0
    assert "2 of 2 episodes hadn't ended after 1 env step and were cut" in " ".join(out.split())


@pytest.mark.parametrize(
    ("env", "file"),
    [
        ("envs/line.py:make", "envs/line.toml"),
        ("aec:envs/line.py", "envs/line.toml"),
        ("mpe2.simple_spread_v3:parallel_env", "line_v0.toml"),
        ("butterfly/pistonball-v6", "line_v0.toml"),
    ],
)
def test_contract_is_best_written_where_it_is_found(env: str, file: str) -> None:
    """The next command writes a contract beside the environment's file, where there is one."""
    assert contract_file(env, GameForm("line_v0", Contract(), False, (), ())) == file


@pytest.mark.parametrize(
    ("near", "one", "two"),
    [
        (True, 0.1 + 0.2, 0.3),
        (True, np.array([1e6, np.nan]), np.array([1e6 + 0.5, np.nan])),
        (False, 0.9, 0.1),
        (False, np.array([0.5]), np.array([0.5, 0.5])),
        (False, 3, 3.0),
        (False, "left", "right"),
        (False, None, 0.0),
        (False, [[1.0], [1.0, 2.0]], [1.0]),
    ],
)
def test_tolerance_is_advised_for_what_arithmetic_may_do(near: bool, one: Any, two: Any) -> None:
    """What nearly agrees may come from another machine; what else differs is to be fixed."""
    assert is_near(one, two) is near
