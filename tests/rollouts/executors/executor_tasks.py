"""Tasks that executors are tried with, played in processes of their own."""
# ruff: noqa: D103 - a task's name says what it does

import atexit
import os
import signal
import time
from pathlib import Path
from typing import Any


def twice(report: Any, *, number: int) -> int:
    return 2 * number


def process(report: Any) -> int:
    return os.getpid()


def said(report: Any, *, number: int) -> int:
    report(number=number)
    return number


def refuse(report: Any, *, why: str) -> None:
    raise ValueError(why)


def die_once(report: Any, *, mark: str) -> str:
    """Its process is killed from outside, as it were, the first time that it is played."""
    path = Path(mark)
    if not path.exists():
        path.write_text("tried")
        os.kill(os.getpid(), signal.SIGKILL)
    return "played"


def die(report: Any, *, mark: str) -> None:
    with Path(mark).open("a") as file:
        file.write("x")
    os._exit(7)


def be_silent(report: Any) -> None:
    time.sleep(1000)


def wait(report: Any, *, begun: str, ended: str) -> None:
    """Waits until it is interrupted, and notes that."""
    Path(begun).write_text("begun")
    try:
        while True:
            time.sleep(0.01)
            report()
    except KeyboardInterrupt:
        Path(ended).write_text("interrupted")
        raise


def leave_a_note(report: Any, *, note: str) -> None:
    atexit.register(Path(note).write_text, "closed")
