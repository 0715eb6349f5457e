"""No worker outlives its task or its parent, and nothing it held stays open."""

import json
import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from gamekeeper.errors import GamekeeperError
from gamekeeper.rollouts import workers as watch
from gamekeeper.rollouts.workers import TaskOutcome, run_task

PATIENCE_S = 30.0


def run(name: str, arguments: dict[str, Any] | None = None, **options: Any) -> TaskOutcome:
    """Runs one of our tasks."""
    return run_task(f"tests.rollouts.worker_tasks:{name}", arguments or {}, **options)


def descriptors() -> int:
    """How many descriptors this process has open."""
    return len(os.listdir("/proc/self/fd" if sys.platform == "linux" else "/dev/fd"))  # noqa: PTH208


def await_end_of(reader: int) -> bool:
    """Whether everybody who held the fifo open has gone, within our patience."""
    poll = select.poll()
    poll.register(reader, select.POLLIN | select.POLLHUP)
    return bool(poll.poll(PATIENCE_S * 1000)) and os.read(reader, 1) == b""


@pytest.fixture
def fifo(tmp_path: Path) -> Path:
    """A named pipe: who reads it learns when the last writer is gone."""
    path = tmp_path / "fifo"
    os.mkfifo(path)
    return path


@pytest.fixture
def script(tmp_path: Path) -> Callable[..., subprocess.Popen[str]]:
    """Starts a program without a guard around its main part that runs a task and prints lines."""

    def start(name: str, arguments: dict[str, Any]) -> subprocess.Popen[str]:
        program = tmp_path / "program.py"
        program.write_text(
            "import dataclasses, json, signal\n"
            "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # if ignored
            "from gamekeeper.rollouts.workers import run_task\n"
            "show = lambda fields: print(json.dumps(fields), flush=True)\n"
            f"task = 'tests.rollouts.worker_tasks:{name}'\n"
            f"outcome = run_task(task, {arguments!r}, on_message=show)\n"
            "show(dataclasses.asdict(outcome))\n"
        )
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        return subprocess.Popen(
            [sys.executable, str(program)], stdout=subprocess.PIPE, text=True, env=environment
        )

    return start


def test_workers_end_the_task_where_on_message_raises(fifo: Path) -> None:
    """What the caller's function raises comes out, and nothing is left running."""
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)

    def refuse(fields: dict[str, Any]) -> None:
        raise LookupError("refused")

    with pytest.raises(LookupError, match="refused"):
        run("hold", {"fifo": str(fifo)}, on_message=refuse)
    assert await_end_of(reader)
    os.close(reader)


def test_workers_leave_no_descriptor_and_no_zombie() -> None:
    """Fifty tasks that end in every way leave the parent as it was."""
    before = descriptors()
    ways = ["crash", "raise_speechless", "read_input", "return_a_set", "recurse"] * 10
    assert len([run(way) for way in ways]) == 50
    assert before == descriptors()
    with suppress(ChildProcessError):  # none at all, or some of another test's that still runs
        assert os.waitpid(-1, os.WNOHANG) == (0, 0)


def test_workers_end_what_a_task_left_behind(fifo: Path) -> None:
    """A program that a task started doesn't outlive it."""
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    assert run("leave_a_child", {"fifo": str(fifo)}).value == "left"
    assert await_end_of(reader)
    os.close(reader)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has subreapers")
@pytest.mark.parametrize("ending", ["return", "leave", "hang"])
def test_workers_end_daemons(fifo: Path, ending: str) -> None:
    """A daemon in a session of its own doesn't outlive its task, however that ends."""
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    outcome = run("leave_a_daemon", {"fifo": str(fifo), "ending": ending}, limit_s=5.0)
    assert outcome.status == {"return": "done", "leave": "died", "hang": "hung"}[ending]
    assert await_end_of(reader)
    os.close(reader)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has subreapers")
def test_workers_end_daemons_of_a_parent_that_was_killed(
    script: Callable[..., subprocess.Popen[str]], fifo: Path
) -> None:
    """Where the parent dies by SIGKILL, what the task has started ends, too."""
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    with script("leave_a_daemon", {"fifo": str(fifo), "ending": "hang"}) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline()
        parent.kill()
        parent.wait(PATIENCE_S)
    assert await_end_of(reader)
    os.close(reader)


def test_workers_take_one_answer_from_a_task_that_forked() -> None:
    """A fork that comes back has no say, and one that stays doesn't hold the parent up."""
    assert run("fork_and_return").value == 7
    outcome = run("leave_a_fork")
    assert outcome.value == "left"
    assert outcome.seconds < PATIENCE_S


def test_workers_count_the_answer_and_not_the_exit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that hangs or crashes after its answer is ended; the answer stands."""
    monkeypatch.setattr(watch, "EXIT_S", 0.2)
    assert (run("dawdle_at_exit").status, run("dawdle_at_exit").value) == ("done", "answered")
    assert (run("crash_at_exit").status, run("crash_at_exit").value) == ("done", "answered")


def test_workers_interrupt_and_wait_for_the_checksums(
    script: Callable[..., subprocess.Popen[str]],
) -> None:
    """Ctrl-C reaches the task, which finalizes and returns; the outcome says so."""
    with script("finalize_when_interrupted", {}) as parent:
        assert parent.stdout is not None
        assert json.loads(parent.stdout.readline()) == {"ready": True}
        parent.send_signal(signal.SIGINT)
        outcome = json.loads(parent.stdout.readline())
        assert (outcome["status"], outcome["value"]) == ("interrupted", "finalized")
        assert parent.wait(PATIENCE_S) == 0


def test_workers_kill_at_the_second_interrupt(script: Callable[..., subprocess.Popen[str]]) -> None:
    """Who presses Ctrl-C twice doesn't wait for a task that ignores it."""
    with script("ignore_interrupts", {}) as parent:
        assert parent.stdout is not None
        assert json.loads(parent.stdout.readline()) == {"ready": True}
        parent.send_signal(signal.SIGINT)
        assert json.loads(parent.stdout.readline()) == {"ignored": True}
        parent.send_signal(signal.SIGINT)
        outcome = json.loads(parent.stdout.readline())
        assert (outcome["status"], outcome["error"]) == ("interrupted", "interrupted twice")
        assert outcome["seconds"] < watch.GRACE_S
        assert parent.wait(PATIENCE_S) == 0


def test_workers_stop_at_an_event_and_kill_after_the_grace(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another thread can interrupt a task; one that ignores it is killed, its stacks kept."""
    monkeypatch.setattr(watch, "GRACE_S", 0.2)
    monkeypatch.setattr(watch, "TERM_S", 0.2)
    stop = threading.Event()
    outcome = run("ignore_interrupts", stop=stop, on_message=lambda fields: stop.set())
    assert outcome.status == "interrupted"
    assert "not done 0.2 s later in ignore_interrupts" in (outcome.error or "")
    assert "in ignore_interrupts" in (outcome.traceback or "")


def test_workers_run_in_threads_beside_each_other() -> None:
    """An executor may run several tasks at once; each gets its own answer."""
    values: dict[int, object] = {}

    def work(number: int) -> None:
        values[number] = run("add", {"first": number, "second": 1}).value

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
    assert values == {0: 1, 1: 2, 2: 3, 3: 4}


@pytest.mark.parametrize("name", ["hold", "hold_watched_by_a_thread"])
def test_workers_die_with_a_parent_that_is_killed(
    name: str, fifo: Path, script: Callable[..., subprocess.Popen[str]]
) -> None:
    """Kill -9 of the parent leaves no task running."""
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    with script(name, {"fifo": str(fifo)}) as parent:
        assert parent.stdout is not None
        assert json.loads(parent.stdout.readline()) == {"ready": True}
        parent.kill()
        assert await_end_of(reader)
    os.close(reader)


def test_workers_say_why_none_can_be_started(monkeypatch: pytest.MonkeyPatch) -> None:
    """No process is an error with a fix, and leaves no descriptor open."""
    before = descriptors()
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(GamekeeperError, match=r"can't be started[\s\S]*fix:"):
        run("facts")
    monkeypatch.setattr(sys, "executable", "")
    with pytest.raises(GamekeeperError, match="expected"):
        run("facts")
    assert before == descriptors()
