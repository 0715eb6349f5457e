from pathlib import Path
from typing import Any

import pytest

from gamekeeper.errors import RunError
from gamekeeper.runs import recorder
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recorder import RunRecorder
from gamekeeper.runs.recording import record
from gamekeeper.runs.run_check import recover, verify
from tests.runs.plays import played, replayed, step_through, write_env
from tests.runs.walks import Turns, Walk


def die(one: RunRecorder) -> None:
    """As a kill does: what was flushed is there, nothing more is written, the lock is gone."""
    one._closing = True
    one._wake.set()
    one._thread.join()
    one._store.abandon()
    one._is_closed = True


def torn(run: Path, *, env: Any = None, turns: int = 3, level: str = "full") -> None:
    """A run whose recorder died in its second episode, after `turns` turns."""
    before = set(recorder._OPEN)
    wrapped = record(env or Walk(), run, level=level)
    (one,) = set(recorder._OPEN) - before
    step_through(wrapped, seed=1)
    step_through(wrapped, seed=2, turns=turns)
    die(one)


@pytest.mark.parametrize("level", ["full", "digest"])
@pytest.mark.parametrize("turns", [0, 1, 3])
def test_recover_checksums_whole_turns(tmp_path: Path, turns: int, level: str) -> None:
    """A killed run opens, is finalized with its last episode torn, verifies and replays."""
    write_env(tmp_path)
    torn(tmp_path / "run", turns=turns, level=level)
    before = load(tmp_path / "run")

    finalized = recover(tmp_path / "run")

    assert before.manifest["status"] == "open"
    assert (finalized.manifest["status"], finalized.episode_table["end"].to_pylist()) == (
        "recovered",
        ["ended", "torn"],
    )
    assert [5, turns] == finalized.episode_table["turns"].to_pylist()
    assert before.agent_steps.num_rows == finalized.agent_steps.num_rows
    assert verify(tmp_path / "run").ok
    assert replayed(tmp_path / "run").verified


@pytest.mark.parametrize(("turns", "kept"), [(0, 0), (2, 2)])
def test_recover_of_a_run_without_timings(tmp_path: Path, turns: int, kept: int) -> None:
    """A run that was killed within its first flush counts the turns in which somebody acted."""
    write_env(tmp_path)
    before = set(recorder._OPEN)
    wrapped = record(Walk(), tmp_path / "run")
    (one,) = set(recorder._OPEN) - before
    step_through(wrapped, seed=1, turns=turns)
    die(one)
    for path in (tmp_path / "run").glob("timings-*"):
        path.unlink()

    finalized = recover(tmp_path / "run")

    assert ([kept], ["torn"]) == tuple(
        finalized.episode_table[n].to_pylist() for n in ("turns", "end")
    )
    assert verify(tmp_path / "run").ok
    assert replayed(tmp_path / "run").verified


@pytest.mark.parametrize("begun", [False, True])
def test_recover_of_a_run_without_rows(tmp_path: Path, begun: bool) -> None:
    """A run that died before any row was written is read, recovered as failed, and verified."""
    before = set(recorder._OPEN)
    wrapped = record(Walk(), tmp_path / "run")
    (one,) = set(recorder._OPEN) - before
    if begun:
        wrapped.reset(seed=1)
    die(one)
    for path in [*(tmp_path / "run").glob("agent_steps-*"), *(tmp_path / "run").glob("timings-*")]:
        path.unlink()

    read = load(tmp_path / "run")
    finalized = recover(tmp_path / "run", status="failed", error="exit code 3")

    assert (read.agent_steps.num_rows, read.summary.agents) == (0, {})
    assert ["failed"] * begun == finalized.episode_table["end"].to_pylist()
    assert (finalized.summary.agent_steps, finalized.summary.agents) == (0, {})
    assert verify(tmp_path / "run").ok


def test_recover_keeps_the_types_of_actions(tmp_path: Path) -> None:
    """A torn first episode is replayed with the very type of actions that was handed over."""
    by_type = ("float(actions.get(agent, 0))", "float(len(repr(actions[agent])))")
    write_env(tmp_path)

    class Typed(Walk):
        def step(self, actions: Any) -> Any:
            parts = super().step(actions)
            return parts[0], {a: float(len(repr(actions[a]))) for a in actions}, *parts[2:]

    torn(tmp_path / "run", env=Typed(turns=99), turns=3)
    recover(tmp_path / "run")

    assert replayed(tmp_path / "run", by_type, ("turns=TURNS", "turns=99")).verified


def test_recover_notes_a_failure(tmp_path: Path) -> None:
    """Why the process died stands with its last episode, which counts as failed."""
    torn(tmp_path / "run")

    finalized = recover(tmp_path / "run", status="failed", error="killed by SIGSEGV")

    assert finalized.episode_table["end"].to_pylist() == ["ended", "failed"]
    assert finalized.episode_table["error"].to_pylist() == [None, "killed by SIGSEGV"]
    assert (finalized.manifest["status"], finalized.manifest["error"]) == (
        "failed",
        "killed by SIGSEGV",
    )
    assert verify(tmp_path / "run").ok


def test_recover_of_turns_one_after_the_other(tmp_path: Path) -> None:
    """A killed AEC run replays up to its last whole turn."""
    write_env(tmp_path)
    before = set(recorder._OPEN)
    wrapped = record(Turns(), tmp_path / "run")
    (one,) = set(recorder._OPEN) - before
    wrapped.reset(seed=1)
    for _ in range(3):
        wrapped.last()
        wrapped.step(1)
    die(one)

    finalized = recover(tmp_path / "run")

    assert tuple(finalized.episode_table[n].to_pylist() for n in ("turns", "end")) == (
        [3],
        ["torn"],
    )
    assert replayed(tmp_path / "run", env="Turns").verified


def test_recover_leaves_a_finalized_run_alone(tmp_path: Path) -> None:
    """Finalized once is finalized: a second look changes no byte."""
    played(tmp_path, episodes=1)
    before = {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir()}

    assert recover(tmp_path / "run").manifest["status"] == "finalized"

    assert before == {path.name: path.read_bytes() for path in (tmp_path / "run").iterdir()}


def test_recover_waits_for_a_recorder_that_lives(tmp_path: Path) -> None:
    """A run that is being recorded isn't taken from its recorder."""
    env = record(Walk(), tmp_path / "run")
    step_through(env, seed=1)

    with pytest.raises(RunError, match="being recorded"):
        recover(tmp_path / "run")
    env.close()
    assert verify(tmp_path / "run").ok
    with pytest.raises(RunError, match="no run"):
        recover(tmp_path)
