"""Signs of life during Gamekeeper's own long waits (compiling, importing), which aren't hangs."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event, Thread
from time import monotonic
from typing import Final

BEAT_S: Final = 0.1
"""Time between two signs of life, in seconds."""
MOST_S: Final = 600.0
"""Longest wait with signs of life, in seconds: a longer one counts as a hang."""

_signs: list[Callable[[], None]] = []


def signs_to(sign: Callable[[], None]) -> None:
    """Makes waits of this process call `sign` from now on."""
    _signs[:] = [sign]


class Wait:
    """Gives signs of life from a thread, from construction until `end`."""

    __slots__ = ("_over", "_thread")

    def __init__(self) -> None:
        self._over = Event()
        self._thread: Thread | None = None
        if _signs:
            self._thread = Thread(
                target=self._beat, args=(_signs[0],), name="gamekeeper-wait", daemon=True
            )
            self._thread.start()

    def end(self) -> None:
        """Ends the signs, and waits until their thread has ended."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    def _beat(self, sign: Callable[[], None]) -> None:
        until_s = monotonic() + MOST_S
        while monotonic() < until_s and not self._over.wait(BEAT_S):
            sign()
