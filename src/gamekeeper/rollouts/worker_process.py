"""A worker process as its parent holds it, and its stacks made readable."""

import json
import os
import re
import selectors
import signal
import socket
import subprocess
import sys
import sysconfig
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Self

from gamekeeper import import_guard
from gamekeeper.errors import GamekeeperError

# -- What faulthandler writes about the Python stacks of a process, made readable


def tidy(stacks: str, *, without: str) -> str:
    """The stacks without frames of the file named `without`, or threads that are nothing else.

    Args:
        stacks: what faulthandler dumped.
        without: name of a file, its folder left out.
    """
    ours = f'{without}", line '
    blocks = []
    for block in stacks.strip().split("\n\n"):
        lines = [line for line in block.splitlines() if ours not in line]
        if len(lines) > 1 or not block.startswith(("Thread ", "Current thread ")):
            blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


def place(stacks: str | None) -> str | None:
    """Place of the main thread: "step (path.py:12)", frames of the standard library skipped."""
    if not stacks:
        return None
    threads = stacks.split("\n\n")
    current = next((text for text in threads if "Current thread" in text), threads[0])
    frames = re.findall(r'^  File "(.*)", line (\d+) in (.*)$', current, flags=re.MULTILINE)
    library = sysconfig.get_path("stdlib")
    foreign = [
        frame
        for frame in frames
        if not frame[0].startswith((library, "<frozen")) or "-packages" in frame[0]
    ]
    for path, line, name in (foreign or frames)[:1]:
        return f"{name} ({path}:{line})"
    return None


# -- A worker process as its parent holds it: started, listened to, asked for stacks, ended, reaped
#
# What is POSIX here, and what would stand in for it on Windows: the socket pair (there over
# loopback, handed on in a list of handles), the process group (a job object), waitid (the process
# handle), SIGINT (CTRL_BREAK_EVENT), SIGUSR1 and 2 (stacks dumped by a thread of the worker's).

DUMP_S: Final = {"SIGUSR1": 0.5, "SIGUSR2": 2.0}
"""Seconds in which a worker may dump the stacks of its threads: from Python, then from C."""
DEATH_S: Final = 30.0
"""Seconds that a killed process is waited for; a driver may hold it in the kernel."""
END: Final = "SIGQUIT" if sys.platform == "linux" else "SIGKILL"
"""Ends a worker; on Linux its keeper (`worker_main.keep`) kills it, and what it has started."""
KEEPER_S: Final = 5.0
"""Seconds that a keeper has for that."""
LEFTOVERS_S: Final = 0.5
"""Seconds after SIGTERM in which processes that a worker left behind may end."""
CHUNK_BYTES: Final = 1 << 16
STACKS_BYTES: Final = 1 << 20
"""Bytes of dumped stacks that are kept, from the end."""
MAIN: Final = Path(__file__).with_name("worker_main.py")


class WorkerProcess:
    """One child process with a channel for messages and a pipe for the stacks of its threads.

    The child leads a session and a process group of its own: the terminal's Ctrl-C reaches it
    only through `interrupt`, and what the task spawns is found again when it has ended.
    """

    def __init__(
        self,
        order: Mapping[str, object],
        environment: Mapping[str, str],
        *,
        pass_fds: tuple[int, ...] = (),
    ) -> None:
        """Starts the worker; `order` is what `worker_main` reads first.

        The worker imports as this process does: the same path, under the same guard.

        Args:
            pass_fds: descriptors that it inherits under their own numbers.
        Raises:
            GamekeeperError: no process can be started.
            TypeError, ValueError: JSON can't carry the order.
        """
        guard = import_guard.active()
        begin = {
            **order,
            "path": [str(entry) for entry in sys.path],
            "guard": None if guard is None else guard.to_json(),
        }
        self._is_swept = False
        self._unsent = memoryview(json.dumps(begin).encode() + b"\n")
        self._messages: list[tuple[str, Any]] = []
        self._cut = bytearray()
        self._stacks = bytearray()
        try:
            self._start(environment, pass_fds)
        except OSError as error:
            raise GamekeeperError(
                "a worker process can't be started",
                where=sys.executable,
                actual=str(error),
                fix="raise this account's limits (ulimit -n, ulimit -u), or end some programs",
            ) from error

    def _start(self, environment: Mapping[str, str], pass_fds: tuple[int, ...]) -> None:
        ours, theirs = socket.socketpair()
        stacks, their_stacks = os.pipe()
        try:
            passed = (theirs.fileno(), their_stacks)
            arguments = [str(number) for number in (*passed, os.getpid())]
            self._process = subprocess.Popen(
                [sys.executable, *_flags(), str(MAIN), *arguments],
                stdin=subprocess.DEVNULL,
                stdout=_error_stream(),  # what foreign code prints is no result of ours
                stderr=_error_stream(),
                pass_fds=(*passed, *pass_fds),
                env=import_guard.worker_environment(environment),
                start_new_session=True,
            )
        except BaseException:
            ours.close()
            os.close(stacks)
            raise
        finally:
            theirs.close()
            os.close(their_stacks)
        ours.setblocking(False)
        os.set_blocking(stacks, False)
        self._channel, self._stacks_fd = ours, stacks
        self._selector = selectors.DefaultSelector()
        self._selector.register(ours, selectors.EVENT_READ | selectors.EVENT_WRITE)
        self._selector.register(stacks, selectors.EVENT_READ)

    def send(self, message: object) -> None:
        """Sends one more message; the task reads it with `report.order()`.

        Raises:
            TypeError, ValueError: JSON can't carry it.
        """
        self._unsent = memoryview(bytes(self._unsent) + json.dumps(message).encode() + b"\n")
        both = selectors.EVENT_READ | selectors.EVENT_WRITE
        with suppress(KeyError):  # its end of the channel is closed: the exit code tells
            self._selector.modify(self._channel, both)
            self._pump(0.0)

    def messages(self, wait_s: float) -> list[tuple[str, Any]]:
        """Messages since the last call; where there are none, waits up to `wait_s` for some.

        Of a worker that has ended, all that are left.
        """
        if self.has_ended():
            while self._pump(0.0):
                pass
        else:
            self._pump(wait_s)
        messages, self._messages = self._messages, []
        return messages

    def _pump(self, wait_s: float) -> bool:
        """Moves what can be moved at once, after waiting for it; tells whether anything was."""
        if not self._selector.get_map():  # both ends closed: it is about to end, as a rule
            time.sleep(min(wait_s, 0.002))
            return False
        ready = self._selector.select(wait_s)
        for key, events in ready:
            if key.fileobj is not self._channel:
                self._collect_stacks()
                continue
            if events & selectors.EVENT_WRITE:
                self._send()
            if events & selectors.EVENT_READ:
                self._receive()
        return bool(ready)

    def _send(self) -> None:
        with suppress(BlockingIOError, ConnectionError):  # dead before it read: its exit code tells
            self._unsent = self._unsent[self._channel.send(self._unsent) :]
            if self._unsent:
                return
        self._selector.modify(self._channel, selectors.EVENT_READ)

    def _receive(self) -> None:
        try:
            chunk = self._channel.recv(CHUNK_BYTES)
        except BlockingIOError:
            return
        except ConnectionError:
            chunk = b""
        if not chunk:
            self._selector.unregister(self._channel)
        # A line may come in several chunks, and a chunk may hold several lines.
        first, *others = chunk.split(b"\n")
        self._cut += first
        for line in others:
            self._accept(bytes(self._cut))
            self._cut = bytearray(line)

    def _accept(self, line: bytes) -> None:
        # A line that an interrupt, or a task that wrote to a strange descriptor, spoilt is no
        # message; where it was the last one, the exit code has to tell how the task ended.
        with suppress(ValueError, RecursionError):
            match json.loads(line) if line else None:
                case [str(kind), content]:
                    self._messages.append((kind, content))

    def _collect_stacks(self) -> None:
        try:
            chunk = os.read(self._stacks_fd, CHUNK_BYTES)
        except BlockingIOError:
            return
        if not chunk:
            self._selector.unregister(self._stacks_fd)
        self._stacks += chunk
        del self._stacks[:-STACKS_BYTES]

    def dumped(self) -> str | None:
        """The Python stacks that the worker has dumped since the last call, without our frames."""
        stacks = self._stacks.decode(errors="replace")
        self._stacks.clear()
        return tidy(stacks, without=MAIN.name) or None

    def dump(self) -> str | None:
        """The Python stacks of all its threads now; None where it doesn't answer."""
        self._stacks.clear()
        for name, most_s in DUMP_S.items():
            with suppress(ProcessLookupError):
                os.kill(self._process.pid, signal.Signals[name])
            deadline, seen = time.monotonic() + most_s, 0
            while time.monotonic() < deadline and not self.has_ended():
                self._pump(0.05)
                if seen and seen == len(self._stacks):  # nothing more came: it is whole
                    return self.dumped()
                seen = len(self._stacks)
        return self.dumped()

    def has_ended(self) -> bool:
        """The process has ended; it isn't reaped by this, so its id and group are still ours."""
        if self._process.returncode is not None:
            return True
        if not hasattr(os, "waitid"):  # macOS before Python 3.13: reaped by the look, then
            return self._process.poll() is not None
        how = os.WEXITED | os.WNOHANG | os.WNOWAIT
        try:
            return os.waitid(os.P_PID, self._process.pid, how) is not None
        except ChildProcessError:  # this process ignores SIGCHLD: the kernel reaped it
            return True

    def interrupt(self) -> None:
        """Tells the task what Ctrl-C tells a program."""
        with suppress(ProcessLookupError):
            os.kill(self._process.pid, signal.SIGINT)

    def end(self, *, patience_s: float = 0.0) -> int:
        """Ends the worker and all it left behind, reaps it, and returns its exit code.

        Args:
            patience_s: how long after SIGTERM a worker that still runs is killed; 0: at once.
        """
        if not self.has_ended() and patience_s:
            os.kill(self._process.pid, signal.SIGTERM)
            self._await_end(patience_s)
        for name, most_s in ((END, KEEPER_S), ("SIGKILL", DEATH_S)):
            if not self.has_ended():
                os.kill(self._process.pid, signal.Signals[name])
                self._await_end(most_s)
        if not self._is_swept:
            self._is_swept = True
            self._signal_group(signal.SIGTERM)  # before reaping: nobody else can have the id yet
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(1.0)
            deadline = time.monotonic() + LEFTOVERS_S
            while self._signal_group(0) and time.monotonic() < deadline:
                time.sleep(0.005)
            self._signal_group(signal.SIGKILL)
        return -signal.SIGKILL if self._process.returncode is None else self._process.returncode

    def _await_end(self, patience_s: float) -> None:
        deadline = time.monotonic() + patience_s
        while not self.has_ended() and time.monotonic() < deadline:
            self._pump(0.005)

    def _signal_group(self, number: int) -> bool:
        try:
            os.killpg(self._process.pid, number)
        except (ProcessLookupError, PermissionError):  # nobody left; or zombies alone, on macOS
            return False
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.end()
        finally:
            self._selector.close()
            self._channel.close()
            os.close(self._stacks_fd)


def _flags() -> list[str]:
    """Options of the interpreter that this process runs with; -P: no folder in front of the path.

    The path is part of the order, complete, so that isolation (-I, -s) comes with it.
    """
    flags = ["-P", *(f"-W{option}" for option in sys.warnoptions)]
    if sys.flags.optimize:
        flags.append("-" + "O" * sys.flags.optimize)
    if sys.flags.dont_write_bytecode:
        flags.append("-B")
    for name, is_on in (("dev", sys.flags.dev_mode), ("utf8", sys.flags.utf8_mode)):
        if is_on:
            flags.append(f"-X{name}")
    return flags


def _error_stream() -> int:
    try:
        os.fstat(2)
    except OSError:  # a service without a standard error
        return subprocess.DEVNULL
    return 2
