"""Stored values that say what can't be: one error for whatever their decoders meet in them."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Final, ParamSpec, TypeVar

from gamekeeper.errors import EvidenceError, GamekeeperError

P = ParamSpec("P")
R = TypeVar("R")
MOST_SAID: Final = 300  # characters of what a decoder says that the error repeats


def legible(read: Callable[P, R]) -> Callable[P, R]:
    """The same reading; what it meets in damaged values leaves as an EvidenceError.

    A bundle's hashes show accidents, but whoever makes a bundle makes its hashes too. What JSON,
    NumPy, Arrow and a wrong shape raise is no closed list (RecursionError and MemoryError are in
    it), so everything but our own errors is translated. A fault of ours in there is, too: therefore
    it stands around decoders, the error asks to be reported, and its cause is kept.
    """

    @wraps(read)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return read(*args, **kwargs)
        except GamekeeperError:
            raise
        except Exception as error:
            said = f"{type(error).__name__}: {error}".splitlines()[0]
            raise EvidenceError(
                "what is kept there can't be read",
                where=read.__name__.strip("_"),
                expected="values as Gamekeeper writes them",
                seen=said[:MOST_SAID],
                mend="restore it from a copy, or make it again; if nobody changed it, report this",
            ) from error

    return guarded
