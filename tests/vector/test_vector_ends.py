"""What is left of a vector environment when a process of it goes: nothing."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np

from gamekeeper.vector import make
from gamekeeper.vector.wrappers import agent_id
from tests.vector import worlds

HERE = worlds.__file__
PARENT = """
import sys
from gamekeeper.vector import make
venv = make("two_robot_line", 4, engine="process")
venv.reset()
print(*(worker.process._process.pid for worker in venv._engine._workers), flush=True)
sys.stdin.read()
"""


def pids(venv: Any) -> list[int]:
    """The workers' processes."""
    return [worker.process._process.pid for worker in venv._engine._workers]


def is_there(pid: int) -> bool:
    """Whether a process lives; a zombie of somebody else's doesn't."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def test_others_go_on_where_that_is_asked() -> None:
    """A killed worker's copies stand still, with the reason; the others play as they would."""
    with (
        make("warehouse", 4, engine="process", on_failure="go_on") as venv,
        make("warehouse", 4) as alone,
    ):
        for each in (venv, alone):
            each.reset(seed=2)
        os.kill(pids(venv)[0], signal.SIGKILL)
        venv.action_space.seed(0)
        for _ in range(20):
            actions = venv.action_space.sample() * 0
            out, expected = venv.step(actions), alone.step(actions)
            assert np.array_equal(out[0][2:], expected[0][2:])
        assert sorted(out[-1]["failed"]) == [0, 1]
        assert "signal 9" in out[-1]["failed"][0]
        assert not out[-1]["live"][:2].any()


def test_copies_that_are_gone_show_nothing_through_a_wrapper() -> None:
    """Not even the numbers of their agents, which are live no more and have never ended."""
    inside = make("spread", 4, engine="process", workers=2, on_failure="go_on", copy=False)
    with agent_id(inside) as venv:
        venv.reset()
        actions = np.zeros(venv.action_space.shape, np.int64)
        seen, *_, infos = venv.step(actions)
        os.kill(pids(inside)[0], signal.SIGKILL)
        while "failed" not in infos:  # until the death is noticed
            assert seen.any(-1).all()
            seen, *_, infos = venv.step(actions)
        assert sorted(infos["failed"]) == [0, 1]
        assert not seen[:2].any()
        assert seen[2:].any(-1).all()


def test_closing_leaves_no_process() -> None:
    """Workers are ended and reaped."""
    venv = make("two_robot_line", 4, engine="process")
    workers = pids(venv)
    venv.close()
    venv.close()

    assert not any(Path(f"/proc/{pid}").exists() for pid in workers)


def test_killed_parent_leaves_neither_processes_nor_memory() -> None:
    """Workers die with whoever started them, and the memory has no name that could stay."""
    before = set(Path("/dev/shm").iterdir())
    with subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(PARENT)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as parent:
        assert parent.stdout is not None
        workers = [int(pid) for pid in parent.stdout.readline().split()]
        assert len(workers) == 2
        parent.kill()
        parent.wait()
        for pid in workers:  # the kernel kills them as the parent goes; this waits for it
            descriptor = _descriptor(pid)
            if descriptor is not None:
                import select

                select.select([descriptor], [], [], 10)
                os.close(descriptor)
    assert not any(is_there(pid) for pid in workers)
    assert set(Path("/dev/shm").iterdir()) <= before


def _descriptor(pid: int) -> int | None:
    try:
        return os.pidfd_open(pid)
    except ProcessLookupError:
        return None
