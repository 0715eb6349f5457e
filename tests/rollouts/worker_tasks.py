"""Tasks that behave and tasks that don't, run by test_workers in processes of their own."""
# ruff: noqa: D103 - a task's name says what it does
# ruff: noqa: T201 - some tasks print on purpose

import atexit
import ctypes
import gc
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, NoReturn

NOTHING = 7


def add(report: Any, *, first: int, second: int) -> int:
    return first + second


def echo(report: Any, *, value: Any) -> Any:
    return value


def count(report: Any, *, most: int) -> str:
    for number in range(most):
        report(number=number)
        report()
    return "counted"


calls: list[None] = []


def count_calls(report: Any) -> int:
    calls.append(None)
    return len(calls)


def draw_globals(report: Any) -> dict[str, Any]:
    import numpy as np  # here: other tasks load nothing of it

    drawn = {"numpy": int(np.random.randint(1 << 30)), "random": random.getrandbits(30)}
    return {**drawn, "hash": hash("a text")}


def crash(report: Any) -> None:
    ctypes.string_at(0)


def crash_by_signal(report: Any, *, number: int) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.kill(os.getpid(), number)
    threading.Event().wait()


def leave(report: Any, *, code: int) -> None:
    os._exit(code)


def wait_for_ever(report: Any) -> None:
    threading.Event().wait()


def spin_for_ever(report: Any) -> None:
    while True:
        report()


def wait_and_return(report: Any, *, seconds: float) -> str:
    """Waits as a compiler does, with one sign of life at the start and none of the task's own."""
    from gamekeeper.heartbeat import Wait, signs_to  # here: other tasks load nothing of ours

    signs_to(report)
    wait = Wait()
    time.sleep(seconds)
    wait.end()
    return "compiled"


def sleep_in_c(report: Any) -> None:
    """Holds the interpreter in C, where no Python thread can run."""
    ctypes.PyDLL(None).sleep(1000)


def recurse(report: Any) -> None:
    recurse(report)


def take_memory(report: Any, *, size_bytes: int) -> int:
    return len(bytearray(size_bytes))


def print_everywhere(report: Any) -> str:
    print("python says hello")
    os.write(1, b"the descriptor says hello\n")
    subprocess.run([sys.executable, "-c", "print('a child says hello')"], check=True)
    ctypes.CDLL(None).puts(b"C says hello")
    return "printed"


def print_then_crash(report: Any) -> None:
    print("last words")
    os._exit(1)


def read_input(report: Any) -> str:
    return sys.stdin.read()


def facts(report: Any) -> dict[str, Any]:
    return {
        "argv": sys.argv[1:],
        "hash": hash("gamekeeper"),
        "variable": os.environ.get("GAMEKEEPER_TEST"),
        "loaded": sorted(sys.modules),
        "pid": os.getpid(),
        "threads": threading.active_count(),
        "collects": gc.isenabled(),
        "frozen": gc.get_freeze_count(),
    }


class SpeechlessError(Exception):
    """Its message can't be had."""

    def __str__(self) -> str:
        raise RuntimeError("no words")


class PricklyError(Exception):
    """Its notes can't be had."""

    @property
    def __notes__(self) -> list[str]:
        raise KeyboardInterrupt


def raise_speechless(report: Any) -> NoReturn:
    raise SpeechlessError


def raise_prickly(report: Any) -> NoReturn:
    raise PricklyError("ouch")


def raise_chained(report: Any) -> NoReturn:
    try:
        raise KeyError("the cause")
    except KeyError as error:
        raise ValueError("the effect") from error


def raise_exit(report: Any, *, code: Any) -> NoReturn:
    raise SystemExit(code)


def raise_interrupt(report: Any) -> NoReturn:
    raise KeyboardInterrupt


def raise_at_length(report: Any) -> NoReturn:
    raise ValueError("x" * 10_000_000)


def raise_surrogate(report: Any) -> NoReturn:
    raise ValueError("half a character: \udc80")


def return_a_set(report: Any) -> set[int]:
    return {1, 2}


def report_a_set(report: Any) -> None:
    report(what={1, 2})


def close_descriptors(report: Any) -> None:
    os.closerange(3, 64)


def fork_and_return(report: Any) -> int:
    """Comes back twice, as code does that forgets to end its fork."""
    return os.fork() and NOTHING


def finalize_when_interrupted(report: Any) -> str:
    try:
        report(ready=True)
        threading.Event().wait()
    except KeyboardInterrupt:
        return "finalized"
    return "never"


def ignore_interrupts(report: Any) -> None:
    signal.signal(signal.SIGINT, lambda *_: report(ignored=True))
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    report(ready=True)
    while True:
        threading.Event().wait()


def hold(report: Any, *, fifo: str) -> None:
    """Holds a fifo open until it dies."""
    with Path(fifo).open("w"):
        report(ready=True)
        threading.Event().wait()


def hold_watched_by_a_thread(report: Any, *, fifo: str) -> None:
    """Holds a fifo, its process bound to its parent as where the kernel doesn't do it."""
    from gamekeeper.rollouts import worker_main

    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(worker_main.PR_SET_PDEATHSIG, 0)
    sys.platform = "elsewhere"
    worker_main.die_with(os.getppid(), report._fd)
    hold(report, fifo=fifo)


def leave_a_child(report: Any, *, fifo: str) -> str:
    """Leaves a program behind that holds a fifo open."""
    code = "import sys, threading; held = open(sys.argv[1], 'w'); print(flush=True); "
    code += "threading.Event().wait()"
    child = subprocess.Popen([sys.executable, "-c", code, fifo], stdout=subprocess.PIPE)
    assert child.stdout is not None
    child.stdout.readline()
    return "left"


def leave_a_daemon(report: Any, *, fifo: str, ending: str) -> str:
    """Leaves a daemon behind, by double fork, that holds a fifo open in a session of its own."""
    ready, told = os.pipe()
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            held = os.open(fifo, os.O_WRONLY)
            os.write(told, b".")
            while held:
                time.sleep(1.0)
        os._exit(0)
    os.wait()
    os.read(ready, 1)
    report(ready=True)
    if ending == "leave":
        os._exit(3)
    if ending == "hang":
        threading.Event().wait()
    return "left"


def leave_a_fork(report: Any) -> str:
    """Leaves a fork behind that holds the channel to the parent open."""
    if os.fork() == 0:
        signal.pause()
    return "left"


def dawdle_at_exit(report: Any) -> str:
    atexit.register(threading.Event().wait)
    return "answered"


def crash_at_exit(report: Any) -> str:
    atexit.register(os.kill, os.getpid(), signal.SIGSEGV)
    return "answered"


def spawn_with_multiprocessing(report: Any) -> int:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(abs, (-3,))
