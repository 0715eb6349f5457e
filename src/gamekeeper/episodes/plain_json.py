"""Plain data as every reader of JSON takes it."""

import math
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
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


def fields_json(result: Any) -> dict[str, Any]:
    """The fields of a dataclass as plain data, each by its own `to_json` where it has one."""
    return {each.name: plain(getattr(result, each.name)) for each in fields(result)}


def plain(value: Any) -> Any:
    """A value as JSON has it: lists for tuples, and the documents of results."""
    if hasattr(value, "to_json"):
        return value.to_json()
    if is_dataclass(value):
        return fields_json(value)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


P = ParamSpec("P")
R = TypeVar("R")
MOST_SAID: Final = 300  # characters of a decoder's message that the error repeats

DAMAGE: Final = (
    ArithmeticError,
    EOFError,
    MemoryError,
    OSError,
    RecursionError,
    ValueError,
    struct.error,
    zlib.error,
)
"""Exceptions of decoders on broken bytes: JSON, text, NumPy and Arrow raise a ValueError, Parquet
an OSError too; stack and memory run out."""


def is_damage(error: Exception) -> bool:
    """True if broken bytes can raise it; anything else, as an AttributeError, is a fault of ours.

    All exceptions of Arrow count, by the name of their module: importing it takes longer than a
    command that needs none of it.
    """
    return isinstance(error, DAMAGE) or type(error).__module__.startswith("pyarrow.")


PLAIN: Final = (type(None), bool, int, float, str, bytes, list, tuple, dict)
"""Types of what JSON spells, and of what it is read into; NumPy's are among them, too."""


def is_misshapen(error: Exception) -> bool:
    """True if JSON of another shape can raise it: an entry is missing, or of another type.

    An attribute that one of our own objects lacks is a fault of ours.
    """
    if isinstance(error, AttributeError):
        return isinstance(error.obj, PLAIN) or type(error.obj).__module__ == "numpy"
    return isinstance(error, LookupError | TypeError)


def legible(read: Callable[P, R]) -> Callable[P, R]:
    """The same reading, whose errors on damaged values leave as an EvidenceError.

    A run's hashes show accidents, but the author of a run makes its hashes too. What no damage
    raises is a fault of ours, and leaves as it is.
    """

    @wraps(read)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return read(*args, **kwargs)
        except GamekeeperError:
            raise
        except Exception as error:
            if not (is_damage(error) or is_misshapen(error)):
                raise
            text = f"{type(error).__name__}: {error}".splitlines()[0]
            raise EvidenceError(
                "recorded values can't be read",
                where=read.__name__.strip("_"),
                expected="values as Gamekeeper writes them",
                actual=text[:MOST_SAID],
                fix="restore the run from a copy; if it was never changed, report this",
            ) from error

    return guarded
