"""Threads that step parts of a batch, and sleep while there is nothing to do.

Compiled steps run without the interpreter's lock, so plain threads do. OpenMP's would spin where
cores are busy, which made small batches 250 times slower; these wait in locks.
"""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Callable
from itertools import pairwise
from typing import Any, Final, TypeAlias

Job: TypeAlias = Callable[[int, int], Any]
"""What is done to the copies from the first to before the last."""
PARTS: Final = 6
"""Parts of a batch for each thread."""
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

    def run(self, job: Job, copies: int) -> None:
        """Does the job to all copies, in parts that whichever thread is free takes next.

        A thread that is woken comes late, so parts are smaller than what each has to do.

        Raises:
            Exception: what a job raised, once all are done.
        """
        if self._pid != os.getpid():
            self._hire()
        bounds = parts_of(copies, self.count * PARTS)
        parts = iter(pairwise(bounds))  # handed out one by one, whoever asks

        def share() -> None:
            for first, last in parts:
                job(first, last)

        for mate in self._mates:
            mate.begin(share)
        try:
            share()
        finally:
            for mate in self._mates:
                mate.done.acquire()
        for mate in self._mates:
            if mate.error is not None:
                raise mate.error

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
        self.job: Callable[[], None] | None = None
        self.error: BaseException | None = None

    def begin(self, job: Callable[[], None]) -> None:
        """Has the thread do a job."""
        self.job, self.error = job, None
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
            job()
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
