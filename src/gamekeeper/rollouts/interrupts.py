"""Ctrl-C held back over a few lines that must not be left half done."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Self


class HeldInterrupt:
    """Raises KeyboardInterrupt at the end of the block in place of somewhere within.

    For bookkeeping that takes milliseconds, never for waiting or for foreign code. Outside the main
    thread nobody is interrupted, and where somebody handles Ctrl-C otherwise, that stays so.
    """

    __slots__ = ("_is_ours", "_was_pressed")

    def __enter__(self) -> Self:
        self._was_pressed = False
        self._is_ours = (
            threading.current_thread() is threading.main_thread()
            and signal.getsignal(signal.SIGINT) is signal.default_int_handler
        )
        if self._is_ours:
            signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, kind: object, error: object, episode: object) -> None:
        if self._is_ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            if self._was_pressed:
                raise KeyboardInterrupt

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._was_pressed = True


@contextmanager
def noted_if_interrupted(known: Callable[[], list[str]]) -> Iterator[None]:
    """Adds notes to the KeyboardInterrupt that ends the block: lines of what is known by then."""
    try:
        yield
    except KeyboardInterrupt as stopped:
        for line in known():
            stopped.add_note(line)
        raise
