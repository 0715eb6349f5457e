"""What a worker process says and doesn't say: reports, an answer, silence; and how a task ended."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeAlias

from gamekeeper.run.stacks import place
from gamekeeper.run.worker_process import WorkerProcess

Status: TypeAlias = Literal["done", "raised", "died", "hung", "interrupted"]

TICK_S: Final = 0.1
"""How often an interrupt and the limits are looked at while the worker is silent, in seconds."""
GRACE_S: Final = 10.0
"""How long an interrupted task gets to seal its evidence and return, in seconds."""
TERM_S: Final = 2.0
"""How long after SIGTERM an interrupted worker is killed, in seconds."""
EXIT_S: Final = 5.0
"""How long a process may take to end once its task has answered (atexit, threads), in seconds."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a task ended.

    Attributes:
        status: "done": it returned. "raised": anything, SystemExit included, or it can't be found.
            "died": its process ended without an answer. "hung": it overran `silence_s` or
            `limit_s` and was killed. "interrupted": by Ctrl-C or `stop`.
        value: what it returned, also after an interrupt; tuples come back as lists. None otherwise.
        error: "ValueError: message", "killed by SIGSEGV", "exit code 3",
            "no sign of life for 60 s in step (path.py:12)".
        traceback: as text; of a process that hung or crashed, the Python stacks of its threads.
        seconds: wall time from the call to the end of the process.
    """

    status: Status
    value: object
    error: str | None
    traceback: str | None
    seconds: float


@dataclass(slots=True)
class Watch:
    """Listens to a worker until it has ended, or must be ended; knows then how the task ended.

    A worker that `stays` is listened to until it has answered; it waits for another task then.
    """

    worker: WorkerProcess
    interrupts: Callable[[], int]
    silence_s: float | None
    limit_s: float | None
    stays: bool = False
    answer: tuple[str, Any] | None = None
    answered_s: float | None = None
    interrupted_s: float | None = None
    overrun: str | None = None
    patience_s: float = 0.0
    stacks: str | None = None

    def listen(self, on_message: Callable[[dict[str, Any]], None]) -> None:
        """Hands on reports until the worker has ended or overrun something."""
        begun_s = last_s = time.monotonic()
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
            if has_ended or (self.stays and self.answer is not None):
                return
            self.overrun = self._overrun(now_s, now_s - last_s, now_s - begun_s)

    def _overrun(self, now_s: float, silent_s: float, total_s: float) -> str | None:
        """Why the worker must end now, or None; interrupts it where that is due."""
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
        where = place(self.stacks)
        return f"{what} in {where}" if where else what

    def outcome(self, code: int, memory_bytes: int | None, seconds: float) -> Outcome:
        """How the task ended, now that its process has ended with `code`."""
        kind, content = self.answer or (None, None)
        value = content if kind == "returned" else None
        raised: dict[str, str] = content if kind == "raised" and content else {}
        error, traceback = raised.get("error"), raised.get("traceback", self.stacks)
        if self.interrupted_s is not None:
            error = error or self.overrun or "interrupted"
            return Outcome("interrupted", value, error, traceback, seconds)
        if kind == "returned":
            return Outcome("done", value, None, None, seconds)
        if kind == "raised":
            return Outcome("raised", None, error, traceback, seconds)
        if self.overrun is not None:
            return Outcome("hung", None, self.overrun, self.stacks, seconds)
        cause = _cause(code, memory_bytes)
        return Outcome("died", None, cause, self.worker.dumped(), seconds)


def _cause(code: int, memory_bytes: int | None) -> str:
    """What ended a process that gave no answer."""
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
