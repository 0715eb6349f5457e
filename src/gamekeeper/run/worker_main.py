"""A worker process runs one task, reports on it and says how it ended; `workers` starts it.

It is run as a script and never imported. Until the task's own module is imported it loads nothing
but the standard library, and as little of that as it can: starting a worker has to stay cheap.

The wire, one JSON document a line: first the order comes in (task, arguments, path,
memory_bytes); then go out `["alive", null]`, any number of `["report", fields]`, and at the end
`["returned", value]` or `["raised", {"error": ..., "traceback": ...}]`.
"""

from __future__ import annotations

import faulthandler
import importlib
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

BEAT_S: Final = 0.05
"""Seconds between two bare signs of life: reporting at every turn must cost next to nothing."""
ERROR_CHARS: Final = 10_000
"""Longest text of an error that is handed on, in characters."""
TRACEBACK_CHARS: Final = 200_000
"""Longest traceback that is handed on, in characters; its middle is cut."""
NO_BOUND_BYTES: Final = 1 << 62
"""A bound that no machine reaches, and that the system's own type may not hold."""
OURS: Final = "gamekeeper."
PR_SET_PDEATHSIG: Final = 1
"""Source: Linux, include/uapi/linux/prctl.h."""


class Channel:
    """Carries messages to the process that started this one; called, it is a task's `report`."""

    __slots__ = ("_fd", "_last_s", "_lock")

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._last_s = -BEAT_S
        self._lock = threading.RLock()  # a signal handler of the task's may report in mid-report

    def __call__(self, /, **fields: object) -> None:
        """Reports `fields` to whoever waits for the task; without fields it is a sign of life."""
        if fields:
            self.send("report", fields)
        elif time.monotonic() - self._last_s >= BEAT_S:
            self.send("alive", None)

    def send(self, kind: str, content: object) -> None:
        """Writes one message whole.

        Raises:
            TypeError: JSON can't carry the content.
            OSError: the task has closed the descriptor.
        """
        self.write(encoded(kind, content))

    def write(self, message: bytes) -> None:
        """Writes a message that is encoded already; where nobody reads it, the process ends."""
        unsent = memoryview(message)
        with self._lock:
            while unsent:
                try:
                    unsent = unsent[os.write(self._fd, unsent) :]
                except BrokenPipeError:  # the parent is gone, and wants no traceback from us
                    os._exit(1)
            self._last_s = time.monotonic()

    def order(self) -> Any:
        """Reads the next message: what is to be done; where the parent is gone, the process ends.

        Whoever asks for more than one answers each before the next is sent.
        """
        read = b""
        while not read.endswith(b"\n"):
            chunk = os.read(self._fd, 1 << 16)
            if not chunk:
                os._exit(1)
            read += chunk
        return json.loads(read)


def encoded(kind: str, content: object) -> bytes:
    """One message as it stands on the wire.

    The newline in front ends a line that an interrupt may have cut short.
    """
    return b"\n" + json.dumps([kind, content]).encode() + b"\n"


def die_with(parent: int, channel_fd: int) -> None:
    """Ends this process as soon as `parent` has died, even by SIGKILL.

    On Linux the kernel sees to it, so that no thread of ours runs beside the task (a fork in a
    process with threads warns from Python 3.12 on). Elsewhere a thread waits for the channel's end.
    """
    if sys.platform == "linux":
        try:
            import ctypes

            arguments = (PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
            prctl = ctypes.CDLL(None).prctl
            done = prctl(*(ctypes.c_ulong(int(argument)) for argument in arguments)) == 0
        except (ImportError, OSError, AttributeError):  # no ctypes, or a C library without it
            done = False
        if done:
            if os.getppid() != parent:  # it died before the kernel knew
                os._exit(1)
            return
    watch = threading.Thread(target=_watch, args=(parent, channel_fd), daemon=True)
    watch.start()


def _watch(parent: int, channel_fd: int) -> None:
    """Waits until `parent` is gone. A fork of it may hold the channel open, hence the look."""
    import select

    while os.getppid() == parent:
        readable = select.select([channel_fd], [], [], 1.0)[0]
        if readable and not os.read(channel_fd, 1):
            break
    os._exit(1)


def limit_memory(size_bytes: int | None) -> Callable[[], None]:
    """Bounds the memory of this process, and returns what lifts the bound.

    Linux counts what is written to (RLIMIT_DATA: heap, private mappings, stacks of threads), not
    the address space, of which CUDA, allocators and sanitizers reserve terabytes and use nothing.
    """
    if size_bytes is None or size_bytes >= NO_BOUND_BYTES:
        return lambda: None
    import resource

    which = resource.RLIMIT_DATA if sys.platform == "linux" else resource.RLIMIT_AS
    hard = resource.getrlimit(which)[1]
    soft = size_bytes if hard == resource.RLIM_INFINITY else min(size_bytes, hard)
    resource.setrlimit(which, (soft, hard))
    return lambda: resource.setrlimit(which, (hard, hard))


def find(task: str) -> Callable[..., object]:
    """Imports a task's module and finds the function.

    Raises:
        LookupError: the name isn't `module:function`, or the module has no such function.
        ImportError: there is no such module; whatever else importing it raises comes out too.
    """
    module_name, _, path = task.partition(":")
    if not module_name or not path:
        raise LookupError(f"a task is named 'module:function', not {task!r}")
    if module_name.startswith(OURS):  # nothing of ours stands beside others' tasks
        from gamekeeper.run.pandas_later import pandas_can_wait

        pandas_can_wait()
    module = importlib.import_module(module_name)
    target: object = module
    for name in path.split("."):
        target = getattr(target, name, None)
    if not callable(target):
        place = getattr(module, "__file__", None) or "built in"
        raise LookupError(f"task {task!r}: {module_name} ({place}) has no function {path!r}")
    return target


def perform(order: Mapping[str, Any], channel: Channel) -> bytes:
    """Runs the task and catches everything; the last message: what it returned or raised."""
    process, memory_bytes = os.getpid(), order["memory_bytes"]
    lift = limit_memory(None)
    try:
        end_wait = _signs_while_importing(order["task"], channel)  # its stack isn't limited yet
        try:
            lift = limit_memory(memory_bytes)
            function = find(order["task"])
        finally:
            end_wait()
        channel.send("alive", None)
        value = function(channel, **order["arguments"])
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # too late to interrupt: the answer is there
        message = _answer(order["task"], value)
    except BaseException as error:  # SystemExit and KeyboardInterrupt of foreign code are data too
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        lift()
        message = encoded("raised", _described(error, memory_bytes))
    if os.getpid() != process:  # the task forked, and this is the fork: it has no say
        os._exit(0)
    return message


def _signs_while_importing(task: str, channel: Channel) -> Callable[[], None]:
    """Gives signs of life until what is returned is called; others' tasks give none of their own.

    Importing what our tasks need takes seconds on a busy machine, and no environment is silent
    then. Later waits of ours, such as compiling, give their signs to the same channel.
    """
    if not task.startswith(OURS):
        return lambda: None
    from gamekeeper.waiting import Wait, signs_to

    signs_to(channel)
    return Wait().end


def _answer(task: str, value: object) -> bytes:
    try:
        return encoded("returned", value)
    except (TypeError, ValueError, RecursionError) as error:
        what = f"task {task!r} returned what JSON can't carry: {error}"
        raise TypeError(what) from None


def _described(error: BaseException, memory_bytes: int | None) -> dict[str, str]:
    import traceback

    text = f"{_name(type(error))}: {_message(error)}".removesuffix(": ")
    if memory_bytes is not None and isinstance(error, MemoryError):
        text += f" (memory limit: {memory_bytes:,} bytes)"
    frames = error.__traceback__
    while frames is not None and frames.tb_frame.f_code.co_filename == __file__:
        frames = frames.tb_next
    try:
        trace = "".join(traceback.format_exception(type(error), error, frames))
    except BaseException:  # attributes that raise when looked at: the frames alone, then
        trace = "".join(traceback.format_tb(frames)) + text + "\n"
    return {"error": cut(text, ERROR_CHARS), "traceback": cut(trace, TRACEBACK_CHARS)}


def _name(kind: type[BaseException]) -> str:
    """Names a class as tracebacks do, but for our own errors, whose bare names users know."""
    bare = kind.__module__ in ("builtins", "gamekeeper.errors")
    return kind.__qualname__ if bare else f"{kind.__module__}.{kind.__qualname__}"


def _message(error: BaseException) -> str:
    try:
        return str(error)
    except BaseException as second:  # foreign: its __str__ may do anything
        return f"<no message: its __str__ raised {type(second).__name__}>"


def cut(text: str, most: int) -> str:
    """Text of at most about `most` characters: where it is longer, its middle is left out."""
    if len(text) <= most:
        return text
    half = most // 2
    return f"{text[:half]}\n[... {len(text) - 2 * half:,} characters left out ...]\n{text[-half:]}"


def main() -> None:
    """Prepares the process, runs the task that the parent sends, and hands back how it ended."""
    channel_fd, stacks_fd, parent = (int(argument) for argument in sys.argv[1:])
    die_with(parent, channel_fd)
    for fd in (channel_fd, stacks_fd):
        os.set_inheritable(fd, False)  # programs that the task starts must not hold them open
    faulthandler.enable(stacks_fd)
    faulthandler.register(signal.SIGUSR1, stacks_fd)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    channel = Channel(channel_fd)
    order = channel.order()
    sys.path[:] = order["path"]
    del sys.argv[1:]  # the task, or an environment that it imports, may parse them
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:  # by line: what was printed before a crash is worth having
            stream.reconfigure(line_buffering=True, errors="backslashreplace")  # type: ignore[union-attr]
    channel.send("alive", None)
    channel.write(perform(order, channel))


if __name__ == "__main__":
    main()
