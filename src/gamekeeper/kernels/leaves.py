"""Named tuples of arrays, by the keys of a Dict space.

Numba keeps compiled code on disk under its types, and reads a class back by its module and name: so
each of these classes is found under a name that says its fields, in any process.
"""

from __future__ import annotations

from collections import namedtuple
from functools import cache
from typing import Any, Final

from gamekeeper.errors import SpecError

PREFIX: Final = "Leaves__"


def leaves_class(keys: tuple[str, ...]) -> Any:
    """The named tuple with these fields.

    Raises:
        SpecError: a key is no name.
    """
    if not all(key.isidentifier() and not key.startswith("_") and "__" not in key for key in keys):
        raise SpecError(
            "rules can't name a part of an observation",
            where="observation_space",
            expected="keys that are Python names, without two underscores",
            seen=repr(keys),
        )
    return _made(PREFIX + "__".join(keys))


@cache
def _made(name: str) -> Any:
    found = namedtuple(name, name.removeprefix(PREFIX).split("__"))  # type: ignore[misc]  # its fields are known when it runs
    found.__module__, found.__qualname__ = __name__, name
    return found


def __getattr__(name: str) -> Any:
    """The class of that name, for who reads one back."""
    if name.startswith(PREFIX):
        return _made(name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
