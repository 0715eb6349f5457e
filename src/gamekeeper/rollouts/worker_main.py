"""A worker process runs one task, reports on it and says how it ended; `workers` starts it.

It is run as a script and never imported. Until the task's own module is imported it loads nothing
but the standard library, and as little of that as it can: starting a worker has to stay cheap.

The wire, one JSON document a line: first the order comes in (task, arguments, path, guard,
memory_bytes); then go out `["alive", null]`, any number of `["report", fields]`, and at the end
`["returned", value]` or `["raised", {"error": ..., "traceback": ...}]`.
"""

import errno
import faulthandler
import gc
import importlib
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any, Final, NoReturn

BEAT_S: Final = 0.05
"""Seconds between two bare signs of life: reporting at every turn must cost next to nothing."""
ERROR_CHARS: Final = 10_000
"""Longest text of an error that is handed on, in characters."""
TRACEBACK_CHARS: Final = 200_000
"""Longest traceback that is handed on, in characters; its middle is cut."""
NO_BOUND_BYTES: Final = 1 << 62
"""A bound that no machine reaches, and that the system's own type may not hold."""
OURS: Final = "gamekeeper."
PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36
"""Source: Linux, include/uapi/linux/prctl.h."""
END: Final = "SIGQUIT"
"""Tells a keeper to kill its worker, with all that it has started; `worker_process` sends it."""
FORWARDED: Final = ("SIGINT", "SIGTERM", "SIGUSR1", "SIGUSR2", END)
LEFTOVERS_S: Final = 0.5
"""Seconds after SIGTERM in which processes that a task left behind may end."""


class Channel:
    """Carries messages to the process that started this one; called, it is a task's `report`."""

    __slots__ = ("_fd", "_identity", "_last_s", "_lock")

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._identity = _identity_of(fd)
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
        """Writes a message that is encoded already; where nobody reads it, the process ends.

        Raises:
            OSError: as `send`.
        """
        unsent = memoryview(message)
        with self._lock:
            if _identity_of(self._fd) != self._identity:  # perhaps a file of the run by now
                raise OSError(errno.EBADF, "the descriptor belongs to another file")
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


def _identity_of(fd: int) -> tuple[int, int]:
    """Device and number of what a descriptor stands for."""
    found = os.fstat(fd)
    return found.st_dev, found.st_ino


def encoded(kind: str, content: object) -> bytes:
    """One message as it stands on the wire.

    The newline in front ends a line that an interrupt may have cut short.
    """
    return b"\n" + json.dumps([kind, content]).encode() + b"\n"


def _prctl(option: int, value: int) -> bool:
    """Sets an attribute of this process, as Linux has them; tells whether it is set."""
    if sys.platform != "linux":
        return False
    try:
        import ctypes

        arguments = map(ctypes.c_ulong, (option, int(value), 0, 0, 0))
        return bool(ctypes.CDLL(None).prctl(*arguments) == 0)
    except (ImportError, OSError, AttributeError):  # no ctypes, or a C library without it
        return False


def keep(parent: int, *descriptors: int) -> int:
    """Goes on in a fork, whose parent then is a keeper; returns the process to die with.

    The keeper waits. On Linux it adopts whatever the task starts and leaves behind (a daemon by
    double fork, a session of its own), ends all of it once the worker has ended, or its own parent
    has, and then ends as the worker did. Elsewhere there is none: this process is the worker.
    """
    if not _prctl(PR_SET_CHILD_SUBREAPER, 1):
        return parent
    keeper, end = os.getpid(), signal.Signals[END]
    worker = os.fork()
    if not worker:
        return keeper

    def forward(number: int, _: object) -> None:
        try:
            os.kill(worker, signal.SIGKILL if number == end else number)
        except ProcessLookupError:  # it has just ended
            return

    for name in FORWARDED:
        signal.signal(signal.Signals[name], forward)
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    for descriptor in descriptors:
        os.close(descriptor)  # their end is the worker's alone
    # The parent may have died before the kernel was asked: then no signal will come.
    if not _prctl(PR_SET_PDEATHSIG, end) or os.getppid() != parent:
        forward(end, None)
    pid = status = 0
    while pid != worker:  # others are orphans that this process adopted
        pid, status = os.wait()
    for name in FORWARDED:
        signal.signal(signal.Signals[name], signal.SIG_IGN)
    _end_children()
    return _end_as(status)


def _end_children() -> None:
    """Ends and reaps all children of this process, and what becomes a child of it by that."""
    deadline, number = time.monotonic() + LEFTOVERS_S, signal.SIGTERM
    while True:
        try:
            pid, _ = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if pid:
            continue
        if time.monotonic() > deadline:
            number = signal.SIGKILL
        children = os.open(f"/proc/self/task/{os.getpid()}/children", os.O_RDONLY)
        try:
            for child in os.read(children, 1 << 16).split():
                os.kill(int(child), number)
        except PermissionError:  # it has other rights now; nothing of ours can end it
            return
        finally:
            os.close(children)
        time.sleep(0.005)


def _end_as(status: int) -> NoReturn:
    """Ends this process as another one has ended."""
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # the worker has left what there is
        if -code not in (signal.SIGKILL, signal.SIGSTOP):
            signal.signal(-code, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        os.kill(os.getpid(), -code)
    os._exit(code)


def die_with(parent: int, channel_fd: int) -> None:
    """Ends this process as soon as `parent` has died, even by SIGKILL.

    On Linux the kernel sees to it, so that no thread of ours runs beside the task (a fork in a
    process with threads warns from Python 3.12 on). Elsewhere a thread waits for the channel's end.
    """
    if _prctl(PR_SET_PDEATHSIG, signal.SIGKILL):
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
        from gamekeeper.rollouts.pandas_later import pandas_can_wait

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
        signal.signal(signal.SIGINT, signal.default_int_handler)  # until here it ends the process
        end_wait = _signs_while_importing(order["task"], channel)  # its stack isn't limited yet
        try:
            lift = limit_memory(memory_bytes)
            function = find(order["task"])
        finally:
            end_wait()
        channel.send("alive", None)
        if not gc.isenabled():  # the process's first task: what its imports made stays
            gc.freeze()
            gc.enable()
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
    from gamekeeper.heartbeat import Wait, signs_to

    signs_to(channel)
    return Wait().end


def _answer(task: str, value: object) -> bytes:
    try:
        return encoded("returned", value)
    except (TypeError, ValueError, RecursionError) as error:
        what = f"task {task!r} returned what JSON can't carry: {error}"
        raise TypeError(what) from None


def _described(error: BaseException, memory_bytes: int | None) -> dict[str, str | bool]:
    import traceback

    text = f"{_name(type(error))}: {_message(error)}".removesuffix(": ")
    if memory_bytes is not None and issubclass(type(error), MemoryError):
        text += f" (memory limit: {memory_bytes:,} bytes)"
    frames = vars(BaseException)["__traceback__"].__get__(error)  # whatever its class says
    while frames is not None and frames.tb_frame.f_code.co_filename == __file__:
        frames = frames.tb_next
    try:
        episode = "".join(traceback.format_exception(type(error), error, frames))
    except BaseException:  # attributes that raise when looked at: the frames alone, then
        episode = "".join(traceback.format_tb(frames)) + text + "\n"
    return {
        "error": cut(text, ERROR_CHARS),
        "traceback": cut(episode, TRACEBACK_CHARS),
        "is_theirs": _is_theirs(frames),
    }


def _is_theirs(frames: TracebackType | None) -> bool:
    """Tells whether code raised that is neither ours nor a package's or the standard library's."""
    place = ""
    while frames is not None:
        place, frames = frames.tb_frame.f_code.co_filename, frames.tb_next
    folders = __file__.rpartition("run")[0], os.__file__.rpartition("os")[0], "<"
    return bool(place) and not place.startswith(folders) and "-packages" not in place


def _name(kind: type[BaseException]) -> str:
    """Names a class as tracebacks do, but for our own errors, whose bare names users know."""
    try:
        module, name = str.__str__(kind.__module__), str.__str__(kind.__qualname__)
    except BaseException:  # a metaclass may do anything
        return "an exception without a name"
    return name if module in ("builtins", "gamekeeper.errors") else f"{module}.{name}"


def _message(error: BaseException) -> str:
    try:
        return str.__str__(str(error))
    except BaseException as second:  # foreign: its __str__ may do anything
        return f"<no message: its __str__ raised {_name(type(second))}>"


def cut(text: str, most: int) -> str:
    """Text of at most about `most` characters: where it is longer, its middle is left out."""
    if len(text) <= most:
        return text
    half = most // 2
    return f"{text[:half]}\n[... {len(text) - 2 * half:,} characters left out ...]\n{text[-half:]}"


def main() -> None:
    """Prepares the process, runs the task that the parent sends, and hands back how it ended."""
    channel_fd, stacks_fd, parent = (int(argument) for argument in sys.argv[1:])
    die_with(keep(parent, channel_fd, stacks_fd), channel_fd)
    for fd in (channel_fd, stacks_fd):
        os.set_inheritable(fd, False)  # programs that the task starts must not hold them open
    faulthandler.enable(stacks_fd)
    # SIGUSR1 is answered between two byte codes, where every frame is whole. SIGUSR2 is answered
    # at once: the only way where C code doesn't return, and in Python code now and then a crash.
    signal.signal(signal.SIGUSR1, lambda *_: faulthandler.dump_traceback(stacks_fd))
    faulthandler.register(signal.SIGUSR2, stacks_fd)
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # a job in the background ignores it
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    gc.disable()  # importing leaves no garbage, and looking for it takes a seventh of that
    channel = Channel(channel_fd)
    order = channel.order()
    sys.path[:] = order["path"]
    if order["guard"] is not None:
        from gamekeeper.import_guard import ImportGuard, install

        install(ImportGuard(**order["guard"]))
    if order["task"].startswith(OURS):
        from gamekeeper.rollouts.interrupts import lost_interrupts_again

        lost_interrupts_again()
    del sys.argv[1:]  # the task, or an environment that it imports, may parse them
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:  # by line: what was printed before a crash is worth having
            stream.reconfigure(line_buffering=True, errors="backslashreplace")  # type: ignore[union-attr]
    channel.send("alive", None)
    channel.write(perform(order, channel))


if __name__ == "__main__":
    main()
