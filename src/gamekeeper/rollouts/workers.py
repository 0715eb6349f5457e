"""Tasks in worker processes: a crash, a hang or hunger for memory is data."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final, Literal, Protocol, TypeAlias

from gamekeeper.errors import GamekeeperError
from gamekeeper.rollouts.worker_process import WorkerProcess, place

# -- What a worker process says and doesn't say: reports, an answer, silence; and how a task ended

Status: TypeAlias = Literal["done", "raised", "died", "hung", "interrupted"]

TICK_S: Final = 0.1
"""Seconds between looks at interrupts and limits while the worker is silent."""
GRACE_S: Final = 10.0
"""Seconds in which an interrupted task may finalize its evidence and return."""
TERM_S: Final = 2.0
"""Seconds after SIGTERM at which an interrupted worker is killed."""
EXIT_S: Final = 5.0
"""Seconds in which a process may end once its task has answered (atexit, threads)."""


@dataclass(frozen=True, slots=True)
class TaskOutcome:
    """Result of a task.

    Attributes:
        status: "done": it returned. "raised": anything, SystemExit included, or it can't be found.
            "died": its process ended without an answer. "hung": it overran `silence_s` or
            `limit_s` and was killed. "interrupted": by Ctrl-C or `stop`.
        value: what it returned, also after an interrupt; tuples come back as lists. None otherwise.
        error: "ValueError: message", "killed by SIGSEGV", "exit code 3",
            "no sign of life for 60 s in step (path.py:12)".
        traceback: as text; of a process that hung or crashed, the Python stacks of its threads.
        seconds: wall time from the call to the end of the process.
        is_theirs: it was raised by code that is neither ours nor of an installed package.
    """

    status: Status
    value: object
    error: str | None
    traceback: str | None
    seconds: float
    is_theirs: bool = False


@dataclass(slots=True)
class WorkerWatch:
    """Listens to a worker until it has ended, or must be ended; knows then how the task ended.

    A worker that `stays` is listened to until it has answered; it waits for another task then. One
    that `forks` for each task says with which `code` the fork has ended; its own stacks don't tell
    where the task stands.
    """

    worker: WorkerProcess
    interrupts: Callable[[], int]
    silence_s: float | None
    limit_s: float | None
    stays: bool = False
    forks: bool = False
    begun_s: float = field(default_factory=time.monotonic)
    code: int | None = None
    answer: tuple[str, Any] | None = None
    answered_s: float | None = None
    interrupted_s: float | None = None
    overrun: str | None = None
    patience_s: float = 0.0
    stacks: str | None = None

    def listen(self, on_message: Callable[[dict[str, Any]], None]) -> None:
        """Hands on reports until the worker has ended or overrun something."""
        last_s = time.monotonic()
        while self.overrun is None:
            has_ended = self.worker.has_ended()  # asked first: what it sent last is read after
            messages = self.worker.messages(TICK_S)
            now_s = time.monotonic()
            for kind, content in messages:
                last_s = now_s
                if kind == "report":
                    on_message(content)
                elif kind in ("returned", "raised"):
                    self.answer, self.answered_s = (kind, content), now_s
                elif kind == "ended":
                    self.code = content
            is_over = has_ended or self.code is not None
            if is_over or (self.stays and self.answer is not None):
                return
            self.overrun = self._overrun(now_s, now_s - last_s, now_s - self.begun_s)

    def _overrun(self, now_s: float, silent_s: float, total_s: float) -> str | None:
        """Reason why the worker must end now, or None; interrupts it where that is due."""
        count = self.interrupts()
        if count and self.interrupted_s is None:
            self.interrupted_s = now_s
            self.worker.interrupt()
        if self.interrupted_s is not None:
            if count > 1:
                return "interrupted twice"
            if now_s - self.interrupted_s > GRACE_S:
                self.patience_s = TERM_S
                return self._located(f"interrupted, and not done {GRACE_S:g} s later")
        elif self.answered_s is not None:
            if now_s - self.answered_s > EXIT_S:
                return f"still there {EXIT_S:g} s after its answer"
        elif self.silence_s is not None and silent_s > self.silence_s:
            return self._located(f"no sign of life for {self.silence_s:g} s")
        elif self.limit_s is not None and total_s > self.limit_s:
            return self._located(f"not done after {self.limit_s:g} s")
        return None

    def _located(self, what: str) -> str:
        self.stacks = self.worker.dump()
        where = None if self.forks else place(self.stacks)
        return f"{what} in {where}" if where else what

    def outcome(self, code: int, memory_bytes: int | None, seconds: float) -> TaskOutcome:
        """Result of the task, now that its process has ended with `code`."""
        kind, content = self.answer or (None, None)
        value = content if kind == "returned" else None
        raised: dict[str, Any] = content if kind == "raised" and content else {}
        error, traceback = raised.get("error"), raised.get("traceback", self.stacks)
        if self.interrupted_s is not None:
            error = error or self.overrun or "interrupted"
            return TaskOutcome("interrupted", value, error, traceback, seconds)
        if kind == "returned":
            return TaskOutcome("done", value, None, None, seconds)
        if kind == "raised":
            is_theirs = bool(raised.get("is_theirs"))
            return TaskOutcome("raised", None, error, traceback, seconds, is_theirs)
        if self.overrun is not None:
            return TaskOutcome("hung", None, self.overrun, self.stacks, seconds)
        cause = how_ended(code, memory_bytes)
        return TaskOutcome("died", None, cause, self.worker.dumped(), seconds)


def how_ended(code: int, memory_bytes: int | None = None) -> str:
    """Cause of the end of a process that gave no answer."""
    if code >= 0:
        return f"exit code {code}" if code else "exit code 0, before the task returned"
    try:
        name = signal.Signals(-code).name
    except ValueError:  # a real-time signal
        name = f"signal {-code}"
    if memory_bytes is not None:
        return f"killed by {name} (memory limit: {memory_bytes:,} bytes)"
    if -code == signal.SIGKILL:
        return f"killed by {name} (from outside; the system does this when memory runs out)"
    return f"killed by {name}"


# -- Foreign code runs in a process of its own, and its crash, hang or hunger for memory is data
#
# The only place that spawns processes. A task is a function of ours or of a plug-in, named
# "module:function" and called as `function(report, **arguments)`; everything crosses as JSON, never
# as a pickle. Nothing of the parent's `__main__` is imported again, so a script needs no guard.

JSON: TypeAlias = "bool | int | float | str | Sequence[JSON] | Mapping[str, JSON] | None"


class Report(Protocol):
    """First argument of a task: a call hands its fields to `on_message`.

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
    stop: threading.Event | None = None,
) -> TaskOutcome:
    """Runs a task in a fresh process and returns how it ended, whatever it does.

    The process gets this one's `sys.path`, its standard input is empty, what it prints goes to
    standard error. It dies with this process, also when that is killed; what the task has spawned
    is ended after it. Ctrl-C interrupts the task, which gets `GRACE_S` to return; a second one
    kills it.

    Args:
        task: "module:function"; the function may have dots.
        silence_s: longest time without a sign of life (a report, the start of the process, the
            end of the import of the task's module), in seconds; None: for ever.
        limit_s: longest time in all, in seconds.
        memory_bytes: bound of the process's memory, the interpreter included, shared memory not;
            on Linux of its data, elsewhere of its address space, as far as the system obeys.
        on_message: called in this thread with the fields of each report; what it raises ends the
            task and comes out here.
        hash_seed: PYTHONHASHSEED, 0 to 4294967295; None: as this process's environment has it.
        stop: once set, interrupts as Ctrl-C does (Ctrl-C itself reaches only the main thread).
    Raises:
        GamekeeperError: no process can be started here.
        TypeError, ValueError: JSON can't carry the arguments, or `hash_seed` is out of range.
    """
    begun_s = time.monotonic()
    environment = environment_of(hash_seed)
    order = {"task": task, "arguments": dict(arguments), "memory_bytes": memory_bytes}
    with _interrupts(stop) as interrupts, WorkerProcess(order, environment) as worker:
        watch = WorkerWatch(worker, interrupts, silence_s, limit_s)
        watch.listen(on_message or (lambda fields: None))
        code = worker.end(patience_s=watch.patience_s)
        return watch.outcome(code, memory_bytes, time.monotonic() - begun_s)


def environment_of(hash_seed: int | None = None) -> dict[str, str]:
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
            fix="run Gamekeeper with a Python of its own on Linux (on Windows: in WSL)",
        )
    environment = dict(os.environ)
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
