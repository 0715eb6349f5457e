"""Ctrl-C while a vector environment waits or writes: what comes after it is in step and whole."""

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gamekeeper as gk
from gamekeeper.rollouts.worker_process import WorkerProcess
from gamekeeper.runs.comparison import replay
from gamekeeper.runs.run_check import verify
from gamekeeper.vector import kernel_engine, vector_rows


def interrupt_next_wait(patch: pytest.MonkeyPatch) -> None:
    """Ctrl-C comes while the first worker's answer is waited for."""

    def messages(self: WorkerProcess, wait_s: float) -> Any:
        raise KeyboardInterrupt

    patch.setattr(WorkerProcess, "messages", messages)


def test_answers_that_an_interrupt_left_are_not_taken_for_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A step that was interrupted is a step; the next one sees what comes after it."""
    with (
        gk.vector.make("two_robot_line", 4, engine="process", workers=2, seed=1) as venv,
        gk.vector.make("two_robot_line", 4, engine="serial", seed=1) as alone,
    ):
        venv.reset(), alone.reset()
        actions = venv.action_space.sample() * 0
        with monkeypatch.context() as patch:
            interrupt_next_wait(patch)
            with pytest.raises(KeyboardInterrupt):
                venv.step(actions)
        alone.step(actions)
        for _ in range(3):
            found, expected = venv.step(actions), alone.step(actions)
            assert np.array_equal(found[0], expected[0])
            assert np.array_equal(found[4]["episode"], expected[4]["episode"])


def test_recording_goes_on_whole_after_an_interrupt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows that were on their way when Ctrl-C came are in the evidence, and it replays."""
    venv = gk.record(
        gk.vector.make("two_robot_line", 4, engine="process", workers=2), tmp_path / "run"
    )
    venv.reset(seed=0)
    venv.action_space.seed(0)
    for _ in range(4):
        for _ in range(10):
            venv.step(venv.action_space.sample())
        actions = venv.action_space.sample()
        with monkeypatch.context() as patch:
            interrupt_next_wait(patch)
            with pytest.raises(KeyboardInterrupt):
                venv.step(actions)
    venv.close()
    assert verify(tmp_path / "run").ok
    assert replay(tmp_path / "run").verified


@pytest.mark.parametrize("engine", ["serial", "kernel"])
def test_recording_is_whole_where_rows_were_being_written(
    engine: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C while this process writes rows comes once they are written."""
    presses: list[int] = []
    monkeypatch.setattr(vector_rows.InOrder, "take", interrupted(vector_rows.InOrder.take, presses))
    monkeypatch.setattr(vector_rows, "FLUSH_TURNS", 1)
    monkeypatch.setattr(kernel_engine, "FLUSH_S", -1.0)
    venv = gk.record(gk.vector.make("two_robot_line", 4, engine=engine), tmp_path / "run")
    venv.reset(seed=0)
    venv.action_space.seed(0)
    venv.step(venv.action_space.sample())
    presses.append(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        step_on(venv)
    venv.close()
    episodes = gk.load(tmp_path / "run").episode_table
    assert {0, 1, 2, 3} <= set(episodes["episode"].to_pylist())
    assert "ended" in episodes["end"].to_pylist()
    assert verify(tmp_path / "run").ok
    assert replay(tmp_path / "run").verified


def step_on(venv: Any) -> None:
    """Steps until an episode is over for certain."""
    for _ in range(100):
        venv.step(venv.action_space.sample())


def interrupted(take: Any, presses: list[int]) -> Any:
    """The same, with Ctrl-C as it begins to write an end, as often as `presses` has one."""

    def pressed(self: Any, batches: Any) -> None:
        if presses and any(
            "end" in part.schema.names and part["end"].null_count < part.num_rows
            for _, part in batches
        ):
            signal.raise_signal(presses.pop())
        take(self, batches)

    return pressed
