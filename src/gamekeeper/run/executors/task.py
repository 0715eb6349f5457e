"""Tasks by key, how they ended, and what an executor is."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, Self, TypeAlias

from gamekeeper.errors import GamekeeperError
from gamekeeper.run.watch import Outcome

KEY: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._=@,+-]{0,199}")
"""What a key may be: a file's name on every system."""
ATTEMPTS: Final = 3
"""How often a task is tried whose process died."""

OnReport: TypeAlias = Callable[[str, dict[str, Any]], None]
"""Called with a task's key and the fields of its report."""


@dataclass(frozen=True, slots=True)
class Task:
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
                "a task's key can't name a file", where="Task.key", expected=KEY.pattern,
                seen=repr(self.key),
            )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Done:
    """How a task ended, once and for all.

    Attributes:
        key: the task's.
        outcome: of its last attempt; its `value` is small, what is large went to storage.
        attempts: how often it was tried.
    """

    key: str
    outcome: Outcome
    attempts: int = 1


@dataclass(frozen=True, slots=True)
class Limits:
    """What a task may take.

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


class Executor(Protocol):
    """Plays tasks, in whatever order and place, and yields each once, as it ends.

    A context that closes it.
    """

    @property
    def workers(self) -> int:
        """How many tasks are played at a time."""

    def map(
        self,
        tasks: Iterable[Task],
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

    def check_storage(self, place: str) -> None:
        """What any worker writes to the storage, this process reads there.

        Args:
            place: what `Storage.at` opens.
        Raises:
            GamekeeperError: a worker doesn't reach it, or means another place by it.
        """

    def close(self) -> None:
        """Lets go of what tasks were played with."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *error: object) -> None: ...


@contextmanager
def stopped_after(ends: Iterator[Done]) -> Iterator[Iterator[Done]]:
    """What `map` yields; however the loop over it is left, what is in flight then is interrupted.

    Without this an error raised in the loop would keep the iterator, and so its workers, alive for
    as long as its traceback is.
    """
    try:
        yield ends
    finally:
        close = getattr(ends, "close", None)
        if close is not None:
            close()
