"""Experiments shared among worker processes: many small tasks, taken as processes get free."""

from __future__ import annotations

import atexit
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

from gamekeeper.errors import EnvError
from gamekeeper.run.executors.local import LocalExecutor
from gamekeeper.run.executors.task import Executor, Limits, Task, stopped_after


def play_shares(
    call: str,
    shares: Iterable[Mapping[str, Any]],
    take: Callable[[Any], None],
    *,
    workers: int | Executor,
    silence_s: float | None,
    where: str,
    mend: str,
    on_report: Callable[[dict[str, Any]], None] | None = None,
) -> None:
    """Plays each share by a task, `workers` of them at a time.

    Args:
        call: "module:function".
        shares: the arguments of each task; drawn as workers get free, in several threads.
        take: called with what each task returned, once, in this thread.
        workers: how many processes of this machine; or who plays in their place.
        silence_s: longest time without a sign of life.
        where, mend: what an error says of the place and of what to do.
        on_report: called with each report, one at a time, in several threads; of a task that is
            tried again, more than once.
    Raises:
        EnvError: a worker process hung, or died as often as it was tried.
        KeyboardInterrupt: by Ctrl-C.
    """

    def report(key: str, fields: dict[str, Any]) -> None:
        if on_report is not None:
            on_report(fields)

    tasks = (Task(f"share-{number:07d}", call, share) for number, share in enumerate(shares))
    players = LocalExecutor(workers) if isinstance(workers, int) else workers
    answers = players.map(tasks, limits=Limits(silence_s=silence_s), on_report=report)
    with stopped_after(answers) as ends:
        for done in ends:
            end = done.outcome
            if end.status == "interrupted":
                raise KeyboardInterrupt
            if end.status != "done":
                raise EnvError(
                    f"a worker process {end.status} while it played",
                    where=where,
                    seen=str(end.error),
                    mend=mend,
                )
            take(end.value)


Opened = TypeVar("Opened", bound=AbstractContextManager[Any])


@dataclass(slots=True)
class _Kept:
    """The one set-up that a worker process holds open from task to task."""

    key: object = None
    opened: Any = None
    at_exit: list[bool] = field(default_factory=list)

    def close(self) -> None:
        opened, self.key, self.opened = self.opened, None, None
        if opened is not None:
            opened.__exit__(None, None, None)


_KEPT: Final = _Kept()


@contextmanager
def kept_open(key: object, make: Callable[[], Opened]) -> Iterator[Opened]:
    """What `make` opens, kept for the next task of this process that asks for the same.

    At most one is kept, the last. It is closed when another is asked for, when something is raised
    while it is in use, and when the process ends. For worker processes: tasks come one at a time.

    Args:
        key: equal for what is the same.
        make: opens it; what it opened is its own context, which closes it.
    """
    if _KEPT.opened is None or key != _KEPT.key:
        _KEPT.close()
        if not _KEPT.at_exit:
            _KEPT.at_exit.append(True)
            atexit.register(_KEPT.close)
        _KEPT.opened, _KEPT.key = make(), key
    opened: Opened = _KEPT.opened
    try:
        yield opened
    except BaseException:
        _KEPT.close()
        raise
