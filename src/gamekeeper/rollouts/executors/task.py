"""Tasks by key, how they ended, and what an executor is."""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final, Self, TypeAlias

from gamekeeper.errors import GamekeeperError
from gamekeeper.rollouts.workers import TaskOutcome

KEY: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._=@,+-]{0,199}")
"""Form of a key: a file's name on every system."""
ATTEMPTS: Final = 3
"""Times that a task is tried whose process died."""

OnReport: TypeAlias = Callable[[str, dict[str, Any]], None]
"""Called with a task's key and the fields of its report."""


@dataclass(frozen=True, slots=True)
class WorkTask:
    """One piece of work, named by what it makes: two runs of it give the same.

    Attributes:
        key: names the result, never the worker or the attempt.
        call: "module:function", called as `function(report, **arguments)`.
        arguments: plain JSON.
    """

    key: str
    call: str
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuses a key that can't name a file."""
        if not KEY.fullmatch(self.key):
            raise GamekeeperError(
                "a task's key can't name a file",
                where="Task.key",
                expected=KEY.pattern,
                actual=repr(self.key),
                fix="use letters, digits and . _ = @ , + - in the key, at most 200 of them",
            )


@dataclass(frozen=True, slots=True)
class Done:
    """Final result of a task.

    Attributes:
        key: the task's.
        outcome: of its last attempt; its `value` is small, what is large went to storage.
        attempts: how often it was tried.
    """

    key: str
    outcome: TaskOutcome
    attempts: int = 1


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of one task.

    Attributes:
        silence_s: longest time without a sign of life, in seconds; None: for ever.
        limit_s: longest time in all, in seconds.
        memory_bytes: bound of its process's memory.
        attempts: how often it is tried where its process died; where it raised or hung it isn't
            tried again, since it would do the same.
    """

    silence_s: float | None = 60.0
    limit_s: float | None = None
    memory_bytes: int | None = None
    attempts: int = ATTEMPTS


USUAL: Final = Limits()


class Executor(ABC):
    """Plays tasks, in whatever order and place, and yields each once, as it ends.

    A context that closes it.
    """

    @property
    @abstractmethod
    def workers(self) -> int:
        """Number of tasks that run at a time."""

    @abstractmethod
    def _play(
        self, tasks: Iterator[WorkTask], limits: Limits, on_report: OnReport | None
    ) -> Iterator[Done]:
        """Yields each task as it ends; see `map`."""

    def map(
        self,
        tasks: Iterable[WorkTask],
        *,
        limits: Limits = USUAL,
        on_report: OnReport | None = None,
    ) -> Iterator[Done]:
        """Yields each task as it ends; there may be any number: they are drawn as needed.

        Closing the iterator, or Ctrl-C, interrupts those in flight.

        Args:
            on_report: called with reports, one at a time, in any thread; where tasks are played on
                other machines, it may not be called at all.
        """
        return self._play(iter(tasks), limits, on_report)

    @abstractmethod
    def check_storage(self, place: str) -> None:
        """Checks that this process reads what any worker writes to the storage.

        Raises:
            GamekeeperError: a worker doesn't reach it, or means another place by it.
        """

    @abstractmethod
    def close(self) -> None:
        """Lets go of what tasks were played with."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


@contextmanager
def stopped_after(ends: Iterator[Done]) -> Iterator[Iterator[Done]]:
    """Yields from `map`; however the loop over it is left, tasks in flight are interrupted.

    Without this an error raised in the loop would keep the iterator, and so its workers, alive for
    as long as its traceback is.
    """
    try:
        yield ends
    finally:
        close = getattr(ends, "close", None)
        if close is not None:
            close()


def check_workers(workers: int | None) -> None:
    """Raises GamekeeperError for a number of workers below 1; None: one for each core."""
    if workers is not None and workers < 1:
        raise GamekeeperError(
            "the number of workers is too small",
            where="workers",
            expected="at least 1",
            actual=str(workers),
            fix="ask for one worker or more",
        )
