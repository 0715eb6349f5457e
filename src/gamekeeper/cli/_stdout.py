"""The real stdout, reserved for results: other prints go to stderr meanwhile."""

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import TextIO

_STDOUT_FD, _STDERR_FD = 1, 2


def open_standard_streams() -> None:
    """Opens those of the three standard streams that a service has closed, onto nothing.

    Otherwise the next file that is opened gets their numbers, and is written into by prints.
    """
    for number in (0, _STDOUT_FD, _STDERR_FD):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
    sys.stdout = sys.stdout or _nowhere()
    sys.stderr = sys.stderr or _nowhere()


@contextlib.contextmanager
def claimed_stdout() -> Iterator[TextIO]:
    """Yields the real stdout; until the block ends, other writes to stdout arrive at stderr.

    That holds for prints of Python, of libraries in C and of programs that are started, since the
    descriptor is redirected. Where `sys.stdout` is captured (a notebook, a test), only Python's
    prints are redirected.
    """
    ours = sys.stdout
    if _descriptor(ours) != _STDOUT_FD:
        with contextlib.redirect_stdout(sys.stderr):
            yield ours
        return
    ours.flush()
    saved = os.dup(_STDOUT_FD)
    os.dup2(_STDERR_FD, _STDOUT_FD)
    try:
        # "replace": a terminal that can't show a sign of a card still gets the card.
        with os.fdopen(os.dup(saved), "w", encoding=ours.encoding, errors="replace") as out:
            yield out
    finally:
        with contextlib.suppress(ValueError, OSError):  # foreign code may have closed it
            sys.stdout.flush()
        os.dup2(saved, _STDOUT_FD)
        os.close(saved)


def silence(stream: TextIO) -> None:
    """Redirects a stream to nothing: its buffered text would fail to be written again."""
    number = _descriptor(stream)
    if number is not None:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)


def _nowhere() -> TextIO:
    return open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123  # lives as long as we do


def _descriptor(stream: TextIO) -> int | None:
    try:
        return stream.fileno()
    except (AttributeError, OSError, ValueError):
        return None
