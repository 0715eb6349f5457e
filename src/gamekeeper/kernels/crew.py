"""Threads that step parts of a batch, and sleep while there is nothing to do.

Compiled steps run without the interpreter's lock, so plain threads do. OpenMP's would spin where
cores are busy, which made small batches 250 times slower; these wait in locks.
"""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Callable
from typing import Any, Final, TypeAlias

Job: TypeAlias = Callable[[int, int], Any]
"""What is done to the copies from the first to before the last."""
TOGETHER: Final = 16
"""Parts begin at multiples of it, so that two threads seldom write to one line of memory."""


class Crew:
    """As many threads as are asked for, the caller's among them.

    They end with the crew's owner, or with the process; after a fork they are hired anew.

    Args:
        count: threads, 2 or more.
    """

    def __init__(self, count: int) -> None:
        self.count, self._pid = count, 0
        self._mates: tuple[_Mate, ...] = ()

    def run(self, job: Job, copies: int) -> list[Any]:
        """Does the job to all copies, a part in each thread; what it returned, part by part.

        Raises:
            Exception: what a job raised, once all are done.
        """
        if self._pid != os.getpid():
            self._hire()
        bounds = parts_of(copies, self.count)
        for mate, first, last in zip(self._mates, bounds[1:], bounds[2:], strict=False):
            mate.begin(job, first, last)
        try:
            found = [job(0, bounds[1])]
        finally:
            for mate in self._mates[: len(bounds) - 2]:
                mate.done.acquire()
        for mate in self._mates[: len(bounds) - 2]:
            if mate.error is not None:
                raise mate.error
            found.append(mate.found)
        return found

    def _hire(self) -> None:
        self._pid = os.getpid()
        self._mates = tuple(_Mate() for _ in range(self.count - 1))
        for number, mate in enumerate(self._mates):
            threading.Thread(
                target=_work, args=(mate,), name=f"gamekeeper-kernel-{number}", daemon=True
            ).start()
            weakref.finalize(self, mate.dismiss)


class _Mate:
    """One other thread: what it is to do, and what came of it."""

    def __init__(self) -> None:
        self.todo, self.done = threading.Lock(), threading.Lock()
        self.todo.acquire()
        self.done.acquire()
        self.job: Job | None = None
        self.first = self.last = 0
        self.found: Any = None
        self.error: BaseException | None = None

    def begin(self, job: Job, first: int, last: int) -> None:
        """Has the thread do a job."""
        self.job, self.first, self.last, self.error = job, first, last, None
        self.todo.release()

    def dismiss(self) -> None:
        """Ends the thread."""
        self.job = None
        self.todo.release()


def _work(mate: _Mate) -> None:
    while True:
        mate.todo.acquire()
        job = mate.job
        if job is None:
            return
        try:
            mate.found = job(mate.first, mate.last)
        except BaseException as error:  # raised where the crew was asked
            mate.error = error
        del job
        mate.job = None
        mate.done.release()


def parts_of(copies: int, count: int) -> list[int]:
    """Where parts begin, and the end: at most `count` parts, none of them empty."""
    size = -(-copies // count)
    size += -size % TOGETHER
    return [*range(0, copies, size), copies]
