"""Plain data as every reader of JSON takes it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, Final, ParamSpec, TypeVar

from gamekeeper.errors import EvidenceError, GamekeeperError


def finite(value: Any) -> Any:
    """The same plain data, null in place of NaN and infinities, which JSON can't spell."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return value


P = ParamSpec("P")
R = TypeVar("R")
MOST_SAID: Final = 300  # characters of a decoder's message that the error repeats


def legible(read: Callable[P, R]) -> Callable[P, R]:
    """The same reading, whose errors on damaged values leave as an EvidenceError.

    A run's hashes show accidents, but the author of a run makes its hashes too. JSON, NumPy, Arrow
    and a wrong shape raise errors of no closed list (RecursionError and MemoryError are in it), so
    all but our own are translated. A fault of ours in there is, too: therefore this stands around
    decoders only, the error asks to be reported, and its cause is kept.
    """

    @wraps(read)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return read(*args, **kwargs)
        except GamekeeperError:
            raise
        except Exception as error:
            text = f"{type(error).__name__}: {error}".splitlines()[0]
            raise EvidenceError(
                "recorded values can't be read",
                where=read.__name__.strip("_"),
                expected="values as Gamekeeper writes them",
                actual=text[:MOST_SAID],
                fix="restore the run from a copy; if it was never changed, report this",
            ) from error

    return guarded
