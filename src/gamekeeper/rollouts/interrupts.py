"""Ctrl-C held back over a few lines that must not be left half done, and never lost."""

import _thread
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final, Self

# What CPython's `signal` wraps in enumerations: 1 us a call in place of 11, for each episode.
_BARE: Final = sys.modules.get("_signal", signal)

AGAIN_S: Final = 0.01
"""Seconds after which a lost interrupt is raised again: its callback has returned by then."""


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
            and _BARE.getsignal(signal.SIGINT) is signal.default_int_handler
        )
        if self._is_ours:
            _BARE.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, kind: object, error: object, episode: object) -> None:
        if self._is_ours:
            _BARE.signal(signal.SIGINT, signal.default_int_handler)
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


def _interrupt_main() -> None:
    if sys.platform == "win32":
        _thread.interrupt_main()
    else:  # a signal of the system also ends a call that waits
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


def lost_interrupts_again() -> Callable[[], None]:
    """Raises a KeyboardInterrupt again that a callback or a finalizer has lost; returns the undo.

    Python can't raise through C code that calls back into it (Numba's compiler does so for
    seconds), nor out of `__del__`: it prints the exception and goes on.
    """
    before = sys.unraisablehook

    def hook(lost: "sys.UnraisableHookArgs") -> None:
        if isinstance(lost.exc_value, KeyboardInterrupt):
            threading.Timer(AGAIN_S, _interrupt_main).start()
        else:
            before(lost)

    def undo() -> None:
        sys.unraisablehook = before

    sys.unraisablehook = hook
    return undo
