from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pytest
from gymnasium import spaces

from gamekeeper.episodes.buffer import TURN
from gamekeeper.errors import EvidenceError, RunError
from gamekeeper.runs import recorder as recorders
from gamekeeper.runs.files.store import RunStore
from gamekeeper.runs.load_run import load
from gamekeeper.runs.recorder import MOST_TURNS, RunRecorder
from gamekeeper.runs.recording import record
from gamekeeper.runs.run_check import recover, verify
from tests.runs.plays import WALKS, played, step_through
from tests.runs.walks import Walk


class Images(Walk):
    """Its observations are large enough to go through a ring."""

    def __init__(self, turns: int = 5) -> None:
        super().__init__(turns)
        self.observation_spaces = {
            agent: spaces.Box(0, 255, (64, 64, 3), np.uint8) for agent in self.possible_agents
        }

    def see(self) -> dict[str, Any]:
        shape = (64, 64, 3)
        return {agent: self.rng.integers(0, 256, shape, np.uint8) for agent in self.agents}


def is_full(self: RunStore, stream: str, batch: Any) -> None:
    """What `RunStore.append` says once no byte fits any more."""
    raise RunError("writing failed: No space left on device", where=str(self.path))


@pytest.mark.parametrize("kind", [Walk, Images])
def test_recorder_says_that_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: type[Walk]
) -> None:
    """The step that looks next raises it, nothing hangs, and what was written can be recovered."""
    env = record(kind(turns=100_000), tmp_path / "run")
    env.reset(seed=1)
    monkeypatch.setattr(RunStore, "append", is_full)

    def step_on() -> None:
        for _ in range(2 * MOST_TURNS):  # a full buffer waits for the writer, however late it is
            env.step({"a": 1, "b": 1})

    with pytest.raises(RunError, match="No space left"):
        step_on()
    with pytest.raises(RunError, match="No space left"):
        env.close()
    monkeypatch.undo()
    assert recover(tmp_path / "run").manifest["status"] == "recovered"


def test_recorder_holds_the_step_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While the writer is slow the buffer stays bounded; nothing is lost."""
    append, longest = RunStore.append, 0

    def slow(self: RunStore, stream: str, batch: Any) -> None:
        time.sleep(0.02)
        append(self, stream, batch)

    monkeypatch.setattr(RunStore, "append", slow)
    env = record(Walk(turns=100_000), tmp_path / "run")
    buffer = env._capture.sink.buffer
    env.reset(seed=1)
    turns = 3 * MOST_TURNS
    for _ in range(turns):
        env.step({"a": 1, "b": 1})
        longest = max(longest, len(buffer.turns) // TURN)
    env.close()

    assert longest <= MOST_TURNS + 512
    assert [turns] == load(tmp_path / "run").episode_table["turns"].to_pylist()


@pytest.mark.parametrize("kind", ["file", "full", "read-only", "below a file"])
def test_recorder_refuses_a_folder_that_it_cannot_have(tmp_path: Path, kind: str) -> None:
    """Something in the way is said at once, and stays as it was."""
    run = tmp_path / "run"
    if kind == "file":
        run.write_text("mine", encoding="utf-8")
    elif kind == "full":
        run.mkdir()
        (run / "mine").touch()
    elif kind == "below a file":
        (tmp_path / "file").touch()
        run = tmp_path / "file" / "run"
    else:
        if os.geteuid() == 0:
            pytest.skip("root may write anywhere")
        run.mkdir(mode=0o500)
    before = set(threading.enumerate())

    with pytest.raises(RunError):
        record(Walk(), run)
    assert set(threading.enumerate()) <= before  # those of earlier tests may end
    assert kind != "full" or [run / "mine"] == list(run.iterdir())


def test_recorder_says_that_a_disk_is_read_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the operating system refuses is named with the fix."""

    def refuse(self: Path, *args: Any, **kwargs: Any) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(self))

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(RunError, match="on a disk that isn't read-only"):
        record(Walk(), tmp_path / "run")


def test_recorder_knows_its_levels(tmp_path: Path) -> None:
    """A level that isn't there is refused before anything is made."""
    with pytest.raises(EvidenceError, match="no such level"):
        record(Walk(), tmp_path / "run", level="everything")
    assert not (tmp_path / "run").exists()


def run_script(text: str, *arguments: object, hash_seed: int = 0) -> str:
    """What a script prints in a process of its own, beside the environments of these tests."""
    # pyarrow imports pandas where there is one, which takes longer than all the rest
    head = "import sys, types\n"
    head += "def find_spec(name, *_):\n    if name == 'pandas':\n        raise ImportError\n"
    head += "sys.meta_path.insert(0, types.SimpleNamespace(find_spec=find_spec))\n"
    done = subprocess.run(
        [sys.executable, "-c", head + text, *map(str, arguments)],
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(WALKS.parent), *filter(None, sys.path)]),
            "PYTHONHASHSEED": str(hash_seed),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


UNCLOSED = """
from walks import Walk, Turns
from gamekeeper.runs.recording import record
one, two = record(Walk(), sys.argv[1]), record(Turns(), sys.argv[2])
one.reset(seed=1)
two.reset(seed=1)
for turn in range(3):
    one.step({"a": 1, "b": 2})
    two.last()
    two.step(1)
two.last()
{end}
"""


@pytest.mark.parametrize("end", ["", "sys.exit(3)", "raise KeyboardInterrupt"])
def test_recorder_that_nobody_closed_is_finalized(tmp_path: Path, end: str) -> None:
    """The end of the process finalizes what is open, its last episode kept as cut."""
    try:
        run_script(UNCLOSED.replace("{end}", end), tmp_path / "one", tmp_path / "two")
    except subprocess.CalledProcessError:
        assert end

    for name in ("one", "two"):
        assert verify(tmp_path / name).ok
        evidence = load(tmp_path / name)
        assert (
            evidence.manifest["status"],
            *(evidence.episode_table[column].to_pylist() for column in ("end", "turns")),
        ) == ("finalized", ["cut"], [3])
        assert 3 in evidence.agent_steps["turn"].to_pylist()


FORKED = """
import os
from walks import Walk
from gamekeeper.errors import RunError
from gamekeeper.runs.recording import record
env = record(Walk(turns=10**6), sys.argv[1])
env.reset(seed=1)
env.step({"a": 1, "b": 1})
child = os.fork()
if not child:
    try:
        for _ in range(10_000):
            env.step({"a": 2, "b": 2})
    except RunError as error:
        print(str(error).splitlines()[0], flush=True)
    sys.exit()
assert os.waitpid(child, 0)[1] == 0
env.step({"a": 1, "b": 1})
env.close()
"""


def test_recorder_is_not_a_forks(tmp_path: Path) -> None:
    """A fork that steps on is told so, and what its parent records stays its parent's."""
    said = run_script(FORKED, tmp_path / "run")

    assert said == "a recorded environment was stepped in a fork of the process that records it\n"
    assert load(tmp_path / "run").episode_table["turns"].to_pylist() == [2]
    assert verify(tmp_path / "run").ok


HASHED = """
from gamekeeper.runs.recording import rollout
print(rollout(sys.argv[1], episodes=2, seed=3, out=sys.argv[2]).fingerprint)
"""


@pytest.mark.parametrize("env", ["Walk", "Turns"])
def test_recorder_has_one_fingerprint_under_all_hash_seeds(tmp_path: Path, env: str) -> None:
    """Two processes with other hash seeds, and this one in memory, get one fingerprint."""
    from gamekeeper.runs.recording import rollout

    prints = {
        run_script(HASHED, f"walks:{env}", tmp_path / str(seed), hash_seed=seed).strip()
        for seed in (1, 2)
    }
    here = rollout(f"{WALKS}:{env}", episodes=2, seed=3)

    assert {here.fingerprint} == prints
    assert (
        here.fingerprint
        == rollout(f"{WALKS}:{env}", episodes=2, seed=3, out=tmp_path / "here").fingerprint
    )


def test_recorder_names_spaces_while_it_records(tmp_path: Path) -> None:
    """A reader of an open run can decode its rows: spaces and types of actions are there."""
    env = record(Walk(), tmp_path / "run")
    env.reset(seed=1)
    env.step({"a": np.int64(1), "b": 2})
    (one,) = (each for each in recorders._OPEN if each.path == tmp_path / "run")
    one._wake.set()
    deadline = time.monotonic() + 60
    actions: Any = {}
    while not actions and time.monotonic() < deadline:
        time.sleep(0.001)
        evidence = load(tmp_path / "run")  # the rows of a turn are written before it is whole
        actions = next((dict(turn.actions) for e in evidence.episodes for turn in e.turns), {})

    assert (evidence.manifest["status"], list(evidence.spaces)) == ("open", ["a", "b"])
    assert evidence.manifest["action_types"] == {"a": "numpy.int64", "b": "int"}
    assert actions == {"a": 1, "b": 2}
    env.close()
    assert "action_types" not in load(tmp_path / "run").manifest


def test_recorder_survives_threads_that_wait(tmp_path: Path) -> None:
    """Closing twice does nothing more, and leaves no thread behind."""
    before = set(threading.enumerate())
    env = record(Walk(), tmp_path / "run")
    step_through(env, seed=1)
    env.close()
    env.close()

    assert set(threading.enumerate()) <= before  # those of earlier tests may end
    assert verify(tmp_path / "run").ok


def test_recorder_waits_for_frames_to_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames wait in bounded number, and all of them are written."""
    monkeypatch.setattr(recorders, "MOST_FRAMES", 2)
    one = RunRecorder(tmp_path / "run", environment={})
    for turn in range(20):
        one.frame(0, turn, np.full((2, 2, 3), turn, np.uint8))
        assert len(one._frames) <= 2
    one.close()

    assert len(list((tmp_path / "run" / "frames").iterdir())) == 20
    assert verify(tmp_path / "run").ok


def test_recorder_writes_what_others_read(tmp_path: Path) -> None:
    """DuckDB, pandas and polars read the rows, and sum rewards by agent, from the file alone."""
    evidence = played(tmp_path)
    path = str(tmp_path / "run" / "agent_steps.parquet")
    summed = {name: entry.return_mean * 2 for name, entry in evidence.summary.agents.items()}
    query = f"SELECT agent, sum(reward) FROM '{path}' GROUP BY agent"

    assert summed == dict(duckdb.sql(query).fetchall())
    assert summed == pd.read_parquet(path).groupby("agent")["reward"].sum().to_dict()
    frame = pl.read_parquet(path).group_by("agent").agg(pl.col("reward").sum())
    assert summed == dict(frame.iter_rows())
    assert (
        pl.read_parquet(path).height == len(pd.read_parquet(path)) == evidence.agent_steps.num_rows
    )


def test_interpreter_is_shared_as_before_after_a_flush() -> None:
    """Writers get it sooner while any of them flushes, and no longer."""
    before = sys.getswitchinterval()
    with recorders._PROMPT:
        with recorders._PROMPT:
            pass
        assert sys.getswitchinterval() == pytest.approx(recorders.SWITCH_S)
    assert sys.getswitchinterval() == pytest.approx(before)
