"""Processes of this machine, each of which plays task after task, as an executor."""

from __future__ import annotations

import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from itertools import count
from typing import Any, Final, Self

from gamekeeper import import_guard
from gamekeeper.rollouts.executors.task import (
    Done,
    Executor,
    Limits,
    OnReport,
    WorkTask,
    check_workers,
)
from gamekeeper.rollouts.worker_process import WorkerProcess
from gamekeeper.rollouts.workers import TaskOutcome, WorkerWatch, environment_of

# -- A worker that stays: one process plays task after task, and a fresh one follows where it ended
#
# The parent holds a `StayingWorker`; `serve` runs in the process. A task's crash or hang costs that
# task and a start; a process that has played `TASKS_EACH` makes room for a fresh one, so that what
# environments leak stays bounded. A process that is no longer needed ends by itself, so that what a
# task left open is closed (`atexit`).

SERVE: Final = "gamekeeper.rollouts.executors.local:serve"
TASKS_EACH: Final = 1_000
"""Tasks after which a process is replaced: what environments leak would add up."""
FAREWELL_S: Final = 2.0
"""Seconds in which an idle process may end by itself."""


class StayingWorker:
    """Plays one task at a time in a process that outlives them."""

    def __init__(self) -> None:
        self._process: WorkerProcess | None = None
        self._begun_as: object = None
        self._played = 0

    def play(
        self,
        task: WorkTask,
        *,
        limits: Limits,
        on_report: Callable[[dict[str, Any]], None],
        stop: threading.Event,
    ) -> TaskOutcome:
        """Result of one attempt at a task, however it ended.

        Args:
            stop: once set, the task is interrupted as Ctrl-C does.
        Raises:
            GamekeeperError: no process can be started here.
        """
        begun_s = time.monotonic()
        worker = self._given(task, limits.memory_bytes)
        watch = WorkerWatch(
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

    def _given(self, task: WorkTask, memory_bytes: int | None) -> WorkerProcess:
        """The process at work on `task`; a fresh one where there is none that could be."""
        order = {"task": task.call, "arguments": dict(task.arguments)}
        guard = import_guard.active()
        as_now = (memory_bytes, None if guard is None else guard.to_json())
        if self._process is not None and as_now == self._begun_as:
            self._process.send(order)
            return self._process
        self.dismiss()
        begin = {
            "task": SERVE,
            "arguments": {"first": order, "memory_bytes": memory_bytes},
            "memory_bytes": None,  # each task sets its own
        }
        self._process, self._begun_as = WorkerProcess(begin, environment_of()), as_now
        return self._process


def serve(report: Any, *, first: Mapping[str, Any], memory_bytes: int | None) -> None:
    """Plays tasks, each answered before the next is sent; ends when the parent has no more."""
    from gamekeeper.rollouts.worker_main import perform

    order = first
    while order is not None:
        report.write(perform({**order, "memory_bytes": memory_bytes}, report))
        # `perform` leaves Ctrl-C ignored. From here on it ends the process: either nothing is
        # played, or the next task was sent and hasn't begun.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        order = report.order()


# -- Tasks played by processes on this machine

_PATIENCE_S: Final = 0.2
"""Seconds that the caller's thread waits at a time, so that Ctrl-C gets through."""


class LocalExecutor(Executor):
    """Plays tasks in `workers` processes, each of which plays one task after the other.

    As a context it keeps its processes from one `map` to the next, until the context is left: what
    they have imported needn't be imported again. Else they end with the `map` that started them.

    Args:
        workers: how many processes; None: one for each core that this process may use.
    Raises:
        GamekeeperError: there would be nobody.
    """

    def __init__(self, workers: int | None = None) -> None:
        check_workers(workers)
        self._workers = cores() if workers is None else workers
        self._is_entered = False
        self._idle: list[_Slot] = []

    def __enter__(self) -> Self:
        self._is_entered = True
        return self

    @property
    def workers(self) -> int:
        """Number of tasks that run at a time."""
        return self._workers

    def check_storage(self, place: str) -> None:
        """Processes of this machine mean by a place what this one does."""

    def close(self) -> None:
        """Processes that wait for another `map` end."""
        self._is_entered = False
        self._let_go(self._idle)
        self._idle = []

    def _play(
        self, tasks: Iterator[WorkTask], limits: Limits, on_report: OnReport | None
    ) -> Iterator[Done]:
        """Yields each task as it ends; see `Executor.map`.

        Raises:
            GamekeeperError: no process can be started here.
        """
        run = _Run(tasks, limits, on_report, self._workers)
        slots, self._idle = self._idle, []
        slots += [_Slot(place) for place in range(len(slots), self._workers)]
        left = len(slots)
        try:
            for slot in slots:  # in here: Ctrl-C in between stops those that were started
                slot.take(run)
            while left:
                try:
                    ended = run.ended.get(timeout=_PATIENCE_S)
                except queue.Empty:
                    continue
                if ended is None:
                    left -= 1
                elif isinstance(ended, BaseException):
                    raise ended
                else:
                    yield ended
        finally:
            run.stop.set()
            run.drain(slots)
            if self._is_entered and not self._idle:
                self._idle = slots
            else:
                self._let_go(slots)

    def _let_go(self, slots: list[_Slot]) -> None:
        for slot in slots:
            slot.leave()
        for slot in slots:
            slot.join()


class _Run:
    """State that the threads of one `map` share."""

    def __init__(
        self, tasks: Iterator[WorkTask], limits: Limits, on_report: OnReport | None, workers: int
    ) -> None:
        self.stop = threading.Event()
        self.ended: queue.Queue[Done | BaseException | None] = queue.Queue(2 * workers)
        self._tasks, self._limits, self._on_report = tasks, limits, on_report
        self._drawing, self._reporting = threading.Lock(), threading.Lock()

    def work(self, worker: StayingWorker) -> None:
        """Plays tasks until there are no more, or all are to stop."""
        try:
            while (task := self._next()) is not None:
                done = self._played(worker, task)
                if self.stop.is_set():
                    break
                self.ended.put(done)
        except BaseException as error:
            worker.close()
            self.ended.put(error)
        finally:
            self.ended.put(None)

    def _next(self) -> WorkTask | None:
        with self._drawing:
            return None if self.stop.is_set() else next(self._tasks, None)

    def _played(self, worker: StayingWorker, task: WorkTask) -> Done:
        """Result of a task, tried again where its process died."""

        def take(fields: dict[str, Any]) -> None:
            if self._on_report is not None:
                with self._reporting:
                    self._on_report(task.key, fields)

        for attempt in count(1):
            outcome = worker.play(task, limits=self._limits, on_report=take, stop=self.stop)
            if outcome.status != "died" or attempt >= self._limits.attempts or self.stop.is_set():
                break
        return Done(task.key, outcome, attempt)

    def drain(self, slots: list[_Slot]) -> None:
        """Waits for the slots that took this, which may want to hand something over yet."""
        while any(slot.is_at_work() for slot in slots):
            try:
                self.ended.get(timeout=_PATIENCE_S)
            except queue.Empty:
                continue


class _Slot:
    """A thread with a worker's process: it plays what it takes, one `map` after the other.

    One thread for all of them, since Linux ends a worker with the thread that started it.
    """

    def __init__(self, place: int) -> None:
        self._runs: queue.Queue[_Run | None] = queue.Queue()
        self._thread = threading.Thread(
            target=self._work, name=f"gamekeeper-worker-{place}", daemon=True
        )

    def take(self, run: _Run) -> None:
        """Plays for a `map`."""
        if self._thread.ident is None:  # not in __init__: a slot that nobody takes is no thread
            self._thread.start()
        self._runs.put(run)

    def leave(self) -> None:
        """Ends, with its process, once it has played."""
        self._runs.put(None)

    def join(self) -> None:
        """Waits until it has ended."""
        if self._thread.ident is not None:
            self._thread.join()

    def is_at_work(self) -> bool:
        """True while a task runs in it."""
        return self._runs.unfinished_tasks > 0

    def _work(self) -> None:
        worker = StayingWorker()
        try:
            while (run := self._runs.get()) is not None:
                run.work(worker)
                self._runs.task_done()
            worker.dismiss()
        finally:
            worker.close()


def cores() -> int:
    """Number of cores that this process may use, as far as the system tells."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
