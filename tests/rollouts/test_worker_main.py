"""The worker's own main: what it says before a task of ours begins."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from gamekeeper import heartbeat
from gamekeeper.rollouts import worker_main

SOON_S = 30.0


class Heard(worker_main.Channel):
    """A channel that tells when something was sent."""

    def __init__(self) -> None:
        super().__init__(0)
        self.sign = threading.Event()

    def write(self, message: bytes) -> None:
        """Something was sent."""
        self.sign.set()


@pytest.fixture(autouse=True)
def as_before() -> Iterator[None]:
    """Puts back what a worker changes of its process."""
    handler, signs = signal.getsignal(signal.SIGINT), list(heartbeat._signs)
    yield
    signal.signal(signal.SIGINT, handler)
    heartbeat._signs[:] = signs


def importing(channel: Heard, *, signs: bool) -> Callable[[str], Any]:
    """`find`, but importing the task's module lasts until there was a sign of life, or wasn't.

    Its task returns the threads that were begun since and go on. Those of earlier tests may end at
    any time, so that they can't be counted.
    """
    before = set(threading.enumerate())

    def find(task: str) -> Any:
        assert channel.sign.wait(SOON_S if signs else 0.5) == signs
        return lambda report: [each.name for each in threading.enumerate() if each not in before]

    return find


def test_worker_main_importing_our_modules_is_no_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    """While our task's module is imported there are signs of life; its thread ends before it."""
    channel = Heard()
    monkeypatch.setattr(worker_main, "find", importing(channel, signs=True))
    order = {"task": "gamekeeper.runs.worker_tasks:any", "arguments": {}, "memory_bytes": None}
    answer = worker_main.perform(order, channel)
    assert worker_main.encoded("returned", []) == answer


def test_worker_main_importing_others_modules_is_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    """A foreign module that hangs when it is imported gives no signs of life."""
    channel = Heard()
    monkeypatch.setattr(worker_main, "find", importing(channel, signs=False))
    order = {"task": "other:any", "arguments": {}, "memory_bytes": None}
    assert worker_main.encoded("returned", []) == worker_main.perform(order, channel)


@pytest.mark.parametrize("size_bytes", [None, 1 << 62, 10**30])
def test_worker_main_takes_a_bound_that_no_machine_reaches_for_none(size_bytes: int | None) -> None:
    """The system's own type couldn't hold it; nothing is bounded, nothing is lifted."""
    resource = pytest.importorskip("resource")
    before = [resource.getrlimit(which) for which in (resource.RLIMIT_DATA, resource.RLIMIT_AS)]
    worker_main.limit_memory(size_bytes)()
    after = [resource.getrlimit(which) for which in (resource.RLIMIT_DATA, resource.RLIMIT_AS)]
    assert before == after


def test_message_never_goes_into_another_file(tmp_path: Path) -> None:
    """A task that closes all descriptors makes room for a file under the channel's number."""
    read, write = os.pipe()
    channel = worker_main.Channel(write)
    channel.send("alive", None)
    assert os.read(read, 100) == worker_main.encoded("alive", None)
    with (tmp_path / "rows").open("wb") as file:
        os.dup2(file.fileno(), write)
        with pytest.raises(OSError, match="another file"):
            channel.send("alive", None)
    os.close(write)
    os.close(read)
    assert (tmp_path / "rows").read_bytes() == b""
