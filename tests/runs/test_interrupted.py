"""Ctrl-C in the middle of writing, finalizing, claiming and closing; and folders that vanish."""

import ctypes
import os
import shutil
import signal
import threading
from pathlib import Path
from typing import Any

import pytest

import gamekeeper as gk
from gamekeeper.errors import RunError
from gamekeeper.rollouts.interrupts import HeldInterrupt, lost_interrupts_again
from gamekeeper.runs.files.open_streams import finalize_recovered
from gamekeeper.runs.files.store import RunStore
from gamekeeper.runs.run_check import verify
from tests.runs import run_folders
from tests.runs.run_folders import read

CALLS = ("write", "fsync", "replace", "unlink", "open")


def interrupt_at(patch: pytest.MonkeyPatch, number: int) -> None:
    """Ctrl-C comes just before this process's call of the system with this number."""
    left = number

    def wrapped(real: Any) -> Any:
        def call(*arguments: Any, **options: Any) -> Any:
            nonlocal left
            left -= 1
            if left == 0:
                raise KeyboardInterrupt
            return real(*arguments, **options)

        return call

    for name in CALLS:
        patch.setattr(os, name, wrapped(getattr(os, name)))


def drafts(folder: Path) -> list[str]:
    """Files that only exist while something is being written."""
    return [path.name for path in folder.rglob("*.tmp")]


@pytest.mark.parametrize("number", range(1, 24, 2))
def test_interrupted_finalizing_leaves_a_run_that_opens(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Wherever Ctrl-C comes, no draft is left, reading gives the same, and it can be finalized."""
    expected = read(run_folders.finalized_run(tmp_path / "whole"))
    store = RunStore.create(tmp_path / "b", {})
    run_folders.fill(store)
    with monkeypatch.context() as patch:
        interrupt_at(patch, number)
        try:
            store.finalize({})
        except KeyboardInterrupt:
            assert drafts(tmp_path) == []
    run_files = read(tmp_path / "b")
    assert run_files.agent_steps.equals(expected.agent_steps)
    if not run_files.finalized:
        finalize_recovered(tmp_path / "b", {})
    assert read(tmp_path / "b").agent_steps.equals(expected.agent_steps)


@pytest.mark.parametrize("number", range(1, 8))
def test_interrupted_claim_leaves_nothing_or_a_run(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder that was being made is gone again, or is a run that can be recovered."""
    with monkeypatch.context() as patch:
        interrupt_at(patch, number)
        try:
            RunStore.create(tmp_path / "a" / "b", {}).abandon()
        except KeyboardInterrupt:
            assert drafts(tmp_path) == []
    if (tmp_path / "a" / "b").exists():
        finalize_recovered(tmp_path / "a" / "b", {})


def test_interrupted_write_leaves_whole_batches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half a batch is taken back, so that what comes after it can be read."""
    store = RunStore.create(tmp_path / "b", {})
    store.append("episodes", run_folders.begin(0))
    store.append("timings", run_folders.timings(0, 0, 1))
    real = os.write

    def half(descriptor: int, data: Any) -> int:
        real(descriptor, bytes(data)[:100])
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", half)
        with pytest.raises(KeyboardInterrupt):
            store.append("agent_steps", run_folders.steps(0, 0, 1))
    store.append("agent_steps", run_folders.steps(0, 0, 1))
    store.abandon()
    run_files = read(tmp_path / "b")
    assert run_files.agent_steps.num_rows == len(run_folders.AGENTS)
    assert run_files.cuts == ()


def test_recorder_that_was_interrupted_while_closing_is_finalized_by_the_next_close(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C while the writer is waited for doesn't leave the run open for good."""
    from gamekeeper.runs import recorder as recorders

    env = gk.record(gk.make("two_robot_line"), tmp_path / "run")
    env.reset(seed=0)
    (recorder,) = [each for each in recorders._OPEN if each.path == tmp_path / "run"]

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(recorder._thread, "join", interrupted)
        with pytest.raises(KeyboardInterrupt):
            env.close()
    recorder.close()
    assert gk.load(tmp_path / "run").manifest["status"] == "finalized"
    assert verify(tmp_path / "run").ok


def test_folder_that_disappears_is_told(tmp_path: Path) -> None:
    """Stepping goes on; closing says which folder is gone, and nothing comes back in its place."""
    env = gk.record(gk.make("two_robot_line"), tmp_path / "run")
    env.reset(seed=0)
    # In one go: while files are taken away one by one, the writer may still add one.
    shutil.rmtree((tmp_path / "run").rename(tmp_path / "gone"))
    env.step(dict.fromkeys(env.agents, 0))
    with pytest.raises(RunError, match="No such file or directory") as caught:
        env.close()
    assert "run" in caught.value.where
    assert caught.value.fix
    assert list(tmp_path.iterdir()) == []


def test_folder_that_is_moved_away_can_be_recovered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was being recorded went on into the moved files; recovering finalizes them there."""
    store = RunStore.create(tmp_path / "run", {})
    run_folders.fill(store, episodes=1)
    (tmp_path / "run").rename(tmp_path / "moved")
    store.append("episodes", run_folders.begin(1))
    store.append("agent_steps", run_folders.steps(1, 0, 2))
    store.append("states", run_folders.states(1, 0, 2))
    store.append("timings", run_folders.timings(1, 0, 2))
    with pytest.raises(RunError):
        store.finalize({})
    assert not (tmp_path / "run").exists()
    finalize_recovered(tmp_path / "moved", {})
    assert read(tmp_path / "moved").episodes.num_rows == 2


def test_ctrl_c_is_held_back_to_the_end_of_the_block() -> None:
    """What stands in the block is done whole; then the interrupt comes."""
    done = []

    def work() -> None:
        with HeldInterrupt():
            signal.raise_signal(signal.SIGINT)
            done.append("whole")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["whole"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_is_left_to_whoever_handles_it() -> None:
    """Another handler stays in its place, and threads hold nothing back."""
    seen: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: seen.append(number))
    try:
        with HeldInterrupt():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
    assert seen == [signal.SIGINT]
    with HeldInterrupt():
        inside = threading.Thread(target=lambda: HeldInterrupt().__enter__())
        inside.start()
        inside.join()


def test_interrupt_that_a_c_callback_loses_is_raised_again() -> None:
    """Numba's compiler calls back into Python for seconds, where no exception gets through."""

    @ctypes.CFUNCTYPE(None)
    def callback() -> None:
        signal.raise_signal(signal.SIGINT)

    def work() -> None:
        callback()
        threading.Event().wait(10.0)

    undo = lost_interrupts_again()
    try:
        with pytest.raises(KeyboardInterrupt):
            work()
    finally:
        undo()
