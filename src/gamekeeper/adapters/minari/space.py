"""Which spaces Minari can write down and read back the same."""

from __future__ import annotations

import math
from typing import Any

from gymnasium import spaces

from gamekeeper.errors import EvidenceError

Space = spaces.Space[Any]


def check_space(space: Space | None, *, whose: str) -> Space:
    """The space, if a Minari data set of it reads back the same.

    Raises:
        EvidenceError: it doesn't.
    """
    if space is None:
        raise _refused(whose, "none that evidence names")
    fault = _fault(space)
    if fault is None:
        fault = _fault_of_text(space)
    if fault is not None:
        raise _refused(whose, fault)
    return space


def _fault(space: Space) -> str | None:
    if isinstance(space, spaces.Dict):
        bad = [key for key in space.spaces if not is_key(key)]
        if bad:
            return f"a Dict with the key {bad[0]!r}"
        return next(filter(None, map(_fault, space.spaces.values())), None)
    if isinstance(space, spaces.Tuple):
        return next(filter(None, map(_fault, space.spaces)), None)
    if isinstance(space, spaces.Box | spaces.MultiDiscrete | spaces.MultiBinary):
        if not math.prod(space.shape):
            return f"{space!r:.120}, which has no element"
        return None
    if isinstance(space, spaces.Discrete | spaces.Text):
        return None
    return f"{space!r:.120}"


def is_key(key: object) -> bool:
    """Whether HDF5 takes a key as the name of one thing."""
    return isinstance(key, str) and key not in ("", ".", "..") and not set(key) & {"/", "\0"}


def _fault_of_text(space: Space) -> str | None:
    from minari.serialization import deserialize_space, serialize_space

    try:
        again = deserialize_space(serialize_space(space))
        is_same = bool(again == space) and _dtypes(again) == _dtypes(space)
    except Exception as error:  # whatever Minari raises, the space can't be written
        return f"{space!r:.120} ({type(error).__name__}: {error})"
    return None if is_same else f"{space!r:.120}, read back as {again!r:.120}"


def _dtypes(space: Space) -> list[Any]:
    if isinstance(space, spaces.Dict):
        return [_dtypes(space.spaces[key]) for key in sorted(space.spaces)]
    if isinstance(space, spaces.Tuple):
        return [_dtypes(part) for part in space.spaces]
    return [space.dtype]


def _refused(whose: str, seen: str) -> EvidenceError:
    return EvidenceError(
        "Minari can't hold a space", where=whose, seen=seen,
        expected="Box, Discrete, MultiDiscrete, MultiBinary, Text; Dict and Tuple of them",
        mend="`--to numpy` holds any space; --agent leaves others out",
    )  # fmt: skip
