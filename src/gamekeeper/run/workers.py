"""Foreign code runs in a process of its own, and its crash, hang or hunger for memory is data.

The only place that spawns processes. A task is a function of ours or of a plug-in, named
"module:function" and called as `function(report, **arguments)`; everything crosses as JSON, never
as a pickle. Nothing of the parent's `__main__` is imported again, so a script needs no guard.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Protocol, TypeAlias

from gamekeeper.errors import GamekeeperError
from gamekeeper.run.watch import Outcome, Watch
from gamekeeper.run.worker_process import WorkerProcess

JSON: TypeAlias = "bool | int | float | str | Sequence[JSON] | Mapping[str, JSON] | None"


class Report(Protocol):
    """What a task is handed first: a call hands its fields to `on_message`.

    A call is also the sign of life. Without fields it is nothing else, and cheap at every turn.
    """

    def __call__(self, /, **fields: Any) -> None:
        """Reports `fields`; JSON has to be able to carry them."""


def run_task(
    task: str,
    arguments: Mapping[str, JSON],
    *,
    silence_s: float | None = 60.0,
    limit_s: float | None = None,
    memory_bytes: int | None = None,
    on_message: Callable[[dict[str, Any]], None] | None = None,
    hash_seed: int | None = None,
    env: Mapping[str, str] | None = None,
    stop: threading.Event | None = None,
) -> Outcome:
    """Runs a task in a fresh process and returns how it ended, whatever it does.

    The process gets this one's `sys.path`, its standard input is empty, what it prints goes to
    standard error. It dies with this process, also when that is killed; what the task has spawned
    is ended after it. Ctrl-C interrupts the task, which gets `GRACE_S` to return; a second one
    kills it.

    Args:
        task: "module:function"; the function may have dots.
        arguments: handed over by keyword.
        silence_s: longest time without a sign of life (a report, the start of the process, the
            end of the import of the task's module), in seconds; None: for ever.
        limit_s: longest time in all, in seconds.
        memory_bytes: bound of the process's memory, the interpreter included, shared memory not;
            on Linux of its data, elsewhere of its address space, as far as the system obeys.
        on_message: called in this thread with the fields of each report; what it raises ends the
            task and comes out here.
        hash_seed: PYTHONHASHSEED, 0 to 4294967295; None: as this process's environment has it.
        env: environment variables on top of this process's.
        stop: once set, interrupts as Ctrl-C does (Ctrl-C itself reaches only the main thread).

    Raises:
        GamekeeperError: no process can be started here.
        TypeError, ValueError: JSON can't carry the arguments, or `hash_seed` is out of range.
    """
    begun_s = time.monotonic()
    environment = environment_of(hash_seed, env)
    order = {
        "task": task,
        "arguments": dict(arguments),
        "path": [str(entry) for entry in sys.path],
        "memory_bytes": memory_bytes,
    }
    with _interrupts(stop) as interrupts, WorkerProcess(order, environment) as worker:
        watch = Watch(worker, interrupts, silence_s, limit_s)
        watch.listen(on_message or (lambda fields: None))
        code = worker.end(patience_s=watch.patience_s)
        return watch.outcome(code, memory_bytes, time.monotonic() - begun_s)


def environment_of(
    hash_seed: int | None = None, env: Mapping[str, str] | None = None
) -> dict[str, str]:
    """The environment variables of a worker process.

    Raises:
        GamekeeperError: no process can be started on this system.
        ValueError: the hash seed is out of range.
    """
    if os.name != "posix" or not sys.executable:
        raise GamekeeperError(
            "a worker process can't be started",
            where=f"{sys.platform}, sys.executable = {sys.executable!r}",
            expected="a POSIX system and the path of its Python",
            mend="run Gamekeeper with a Python of its own on Linux (on Windows: in WSL)",
        )
    environment = {**os.environ, **(env or {})}
    if hash_seed is not None:
        if not 0 <= hash_seed <= 4294967295:
            raise ValueError(f"hash_seed is {hash_seed}; expected 0 to 4294967295")
        environment["PYTHONHASHSEED"] = str(hash_seed)
    return environment


@contextmanager
def _interrupts(stop: threading.Event | None) -> Iterator[Callable[[], int]]:
    """Counts Ctrl-C instead of raising in the midst of the bookkeeping; yields the count.

    Somebody else's handler stays: what it raises ends the worker and goes on its way.
    """
    count = 0

    def note(number: int, frame: object) -> None:
        nonlocal count
        count += 1

    is_ours = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if is_ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield lambda: count or int(stop is not None and stop.is_set())
    finally:
        if is_ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
