"""Tasks played by processes on this machine."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, Self

from gamekeeper.errors import GamekeeperError
from gamekeeper.run.executors.task import USUAL, Done, Limits, OnReport, Task
from gamekeeper.run.executors.worker import StayingWorker

_PATIENCE_S: Final = 0.2
"""How long the caller's thread waits at a time, so that Ctrl-C gets through, in seconds."""


class LocalExecutor:
    """Plays tasks in `workers` processes, each of which plays one task after the other.

    As a context it keeps its processes from one `map` to the next, until the context is left: what
    they have imported needn't be imported again. Else they end with the `map` that started them.

    Args:
        workers: how many processes; None: one for each core that this process may use.

    Raises:
        GamekeeperError: there would be nobody.
    """

    def __init__(self, workers: int | None = None) -> None:
        if workers is not None and workers < 1:
            raise GamekeeperError(
                "nobody would play", where="workers", expected="at least 1", seen=str(workers)
            )
        self._workers = cores() if workers is None else workers
        self._is_entered = False
        self._idle: list[_Seat] = []

    def __enter__(self) -> Self:
        self._is_entered = True
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @property
    def workers(self) -> int:
        """How many tasks are played at a time."""
        return self._workers

    def check_storage(self, place: str) -> None:
        """Processes of this machine mean by a place what this one does."""

    def close(self) -> None:
        """Processes that wait for another `map` end."""
        self._is_entered = False
        self._let_go(self._idle)
        self._idle = []

    def map(
        self,
        tasks: Iterable[Task],
        *,
        limits: Limits = USUAL,
        on_report: OnReport | None = None,
    ) -> Iterator[Done]:
        """Yields each task as it ends; see `Executor.map`.

        Raises:
            GamekeeperError: no process can be started here.
        """
        run = _Run(iter(tasks), limits, on_report, self._workers)
        seats, self._idle = self._idle, []
        seats += [_Seat(place) for place in range(len(seats), self._workers)]
        left = len(seats)
        try:
            for seat in seats:  # in here: Ctrl-C in between stops those that were started
                seat.take(run)
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
            run.drain(seats)
            if self._is_entered and not self._idle:
                self._idle = seats
            else:
                self._let_go(seats)

    def _let_go(self, seats: list[_Seat]) -> None:
        for seat in seats:
            seat.leave()
        for seat in seats:
            seat.join()


class _Run:
    """What the threads of one `map` share."""

    def __init__(
        self, tasks: Iterator[Task], limits: Limits, on_report: OnReport | None, workers: int
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

    def _next(self) -> Task | None:
        with self._drawing:
            return None if self.stop.is_set() else next(self._tasks, None)

    def _played(self, worker: StayingWorker, task: Task) -> Done:
        return played(worker, task, self._limits, self._taker(task.key), self.stop)

    def _taker(self, key: str) -> Callable[[dict[str, Any]], None]:
        def take(fields: dict[str, Any]) -> None:
            if self._on_report is not None:
                with self._reporting:
                    self._on_report(key, fields)

        return take

    def drain(self, seats: list[_Seat]) -> None:
        """Waits for the seats that took this, which may want to hand something over yet."""
        while any(seat.is_at_work() for seat in seats):
            try:
                self.ended.get(timeout=_PATIENCE_S)
            except queue.Empty:
                continue


class _Seat:
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
        if self._thread.ident is None:  # not in __init__: a seat that nobody takes is no thread
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
        """Whether it plays."""
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


def played(
    worker: StayingWorker,
    task: Task,
    limits: Limits,
    on_report: Callable[[dict[str, Any]], None],
    stop: threading.Event,
) -> Done:
    """How a task ended, tried again where its process died."""
    attempt = 0
    while True:
        attempt += 1
        outcome = worker.play(task, limits=limits, on_report=on_report, stop=stop)
        if outcome.status != "died" or attempt >= limits.attempts or stop.is_set():
            return Done(task.key, outcome, attempt)


def cores() -> int:
    """How many cores this process may use, as far as the system tells."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
