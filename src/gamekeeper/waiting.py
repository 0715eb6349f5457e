"""Long waits of our own (compiling, importing) that a process' watch must not take for a hang."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event, Thread
from time import monotonic
from typing import Final

BEAT_S: Final = 0.1
"""Between two signs of life, in seconds."""
MOST_S: Final = 600.0
"""Longest wait that signs are given for, in seconds: what takes longer may be called a hang."""

_signs: list[Callable[[], None]] = []
_open: list[float] = []
"""When each wait that isn't over began."""
_waited_s: float = 0.0


def own_s() -> float:
    """A clock, in seconds, that stands still for waits that came to their end."""
    return monotonic() - _waited_s


def signs_to(sign: Callable[[], None]) -> None:
    """From now on waits of this process call `sign`; before, they tell nobody."""
    _signs[:] = [sign]


class Wait:
    """Gives signs of life from a thread, from construction until `end`."""

    __slots__ = ("_over", "_thread")

    def __init__(self) -> None:
        _open.append(monotonic())
        self._over = Event()
        self._thread: Thread | None = None
        if _signs:
            self._thread = Thread(
                target=self._beat, args=(_signs[0],), name="gamekeeper-wait", daemon=True
            )
            self._thread.start()

    def end(self) -> None:
        """What was waited for is done; no thread is left beside what comes next."""
        global _waited_s
        if not self._over.is_set():
            since_s = _open.pop()
            if not _open:  # what is waited for within another wait is part of that one
                _waited_s += monotonic() - since_s
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    def _beat(self, sign: Callable[[], None]) -> None:
        until_s = monotonic() + MOST_S
        while monotonic() < until_s and not self._over.wait(BEAT_S):
            sign()
