"""A worker that stays: one process plays task after task, and a fresh one follows where it ended.

The parent holds a `StayingWorker`; `serve` runs in the process. A task's crash or hang costs that
task and a start; a process that has played `TASKS_EACH` makes room for a fresh one, so that what
environments leak stays bounded. A process that is no longer needed ends by itself, so that what a
task left open is closed (`atexit`).
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from gamekeeper.run.executors.task import Limits, Task
from gamekeeper.run.watch import Outcome, Watch
from gamekeeper.run.worker_process import WorkerProcess
from gamekeeper.run.workers import environment_of

SERVE: Final = "gamekeeper.run.executors.worker:serve"
TASKS_EACH: Final = 1_000
"""Tasks after which a process is replaced: what environments leak would add up."""
FAREWELL_S: Final = 2.0
"""How long a process that isn't at work gets to end by itself, in seconds."""


class StayingWorker:
    """Plays one task at a time in a process that outlives them."""

    def __init__(self) -> None:
        self._process: WorkerProcess | None = None
        self._memory_bytes: int | None = None
        self._played = 0

    def play(
        self,
        task: Task,
        *,
        limits: Limits,
        on_report: Callable[[dict[str, Any]], None],
        stop: threading.Event,
    ) -> Outcome:
        """How one attempt at a task ended, whatever it did.

        Args:
            stop: once set, the task is interrupted as Ctrl-C does.
        Raises:
            GamekeeperError: no process can be started here.
        """
        begun_s = time.monotonic()
        worker = self._given(task, limits.memory_bytes)
        watch = Watch(
            worker, lambda: int(stop.is_set()), limits.silence_s, limits.limit_s, stays=True
        )
        try:
            watch.listen(on_report)
        except BaseException:
            self.close()
            raise
        self._played += 1
        code = 0
        if watch.answer is None or stop.is_set() or worker.has_ended():
            code = self.close(patience_s=watch.patience_s)
        elif self._played >= TASKS_EACH:
            self.dismiss()
        return watch.outcome(code, limits.memory_bytes, time.monotonic() - begun_s)

    def dismiss(self) -> None:
        """Lets the process end by itself, if there is one; it has to be idle."""
        if self._process is None:
            return
        self._process.send(None)
        deadline_s = time.monotonic() + FAREWELL_S
        while not self._process.has_ended() and time.monotonic() < deadline_s:
            self._process.messages(0.05)
        self.close()

    def close(self, *, patience_s: float = 0.0) -> int:
        """Ends the process at once, if there is one; returns its exit code."""
        process, self._process, self._played = self._process, None, 0
        if process is None:
            return 0
        with process:
            return process.end(patience_s=patience_s)

    def _given(self, task: Task, memory_bytes: int | None) -> WorkerProcess:
        """The process at work on `task`; a fresh one where there is none that could be."""
        order = {"task": task.call, "arguments": dict(task.arguments)}
        if self._process is not None and memory_bytes == self._memory_bytes:
            self._process.send(order)
            return self._process
        self.dismiss()
        begin = {
            "task": SERVE,
            "arguments": {"first": order, "memory_bytes": memory_bytes},
            "path": [str(entry) for entry in sys.path],
            "memory_bytes": None,  # each task sets its own
        }
        self._process, self._memory_bytes = WorkerProcess(begin, environment_of()), memory_bytes
        return self._process


def serve(report: Any, *, first: Mapping[str, Any], memory_bytes: int | None) -> None:
    """Plays tasks, each answered before the next is sent; ends when the parent has no more."""
    from gamekeeper.run.worker_main import perform

    order = first
    while order is not None:
        report.write(perform({**order, "memory_bytes": memory_bytes}, report))
        # `perform` leaves Ctrl-C ignored. From here on it ends the process: either nothing is
        # played, or the next task was sent and hasn't begun.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        order = report.order()
