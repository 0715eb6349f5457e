"""Snapshots of what environments hand out and take: changes since, and writing into them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Space

NUMBERS: Final = "biufc"
"""Kinds of arrays that can be overwritten with zeros and ones."""
MOST_KEPT_BYTES: Final = 64 << 20
"""Bytes of arrays that are kept to be written back."""
DEEPEST: Final = 8
"""Containers in containers that are looked into."""
MOST_SPACES: Final = 20_000


@dataclass(frozen=True, slots=True)
class OpaqueValue:
    """An object that can't be copied without running its code: only which one it is counts."""

    identity: int


def snapshot(value: Any, depth: int = DEEPEST) -> Any:
    """A copy of dictionaries, lists, tuples and arrays that shares no memory with `value`."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if not depth or value is None or isinstance(value, bool | int | float | str | np.generic):
        return value
    if isinstance(value, Mapping):
        return {key: snapshot(item, depth - 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [snapshot(item, depth - 1) for item in value]
    return OpaqueValue(id(value))


def is_same(value: Any, copy: Any) -> bool:
    """Tells whether `value` still equals its `snapshot`, bit for bit but for NaN."""
    if isinstance(copy, np.ndarray):
        return isinstance(value, np.ndarray) and _same_arrays(value, copy)
    if isinstance(copy, dict):
        return (
            isinstance(value, Mapping)
            and list(value) == list(copy)
            and all(is_same(value[key], item) for key, item in copy.items())
        )
    if isinstance(copy, list):
        return (
            isinstance(value, list | tuple)
            and len(value) == len(copy)
            and all(map(is_same, value, copy))
        )
    if isinstance(copy, OpaqueValue):
        return id(value) == copy.identity
    return type(value) is type(copy) and bool(value == copy or value != value)


def _same_arrays(value: np.ndarray[Any, Any], copy: np.ndarray[Any, Any]) -> bool:
    if value.dtype != copy.dtype or value.shape != copy.shape:
        return False
    if copy.dtype == object:  # whose elements may be arrays, which == doesn't compare
        return all(is_same(one, other) for one, other in zip(value.flat, copy.flat, strict=True))
    return bool(np.array_equal(value, copy, equal_nan=copy.dtype.kind in "fc"))


def arrays(value: Any, depth: int = DEEPEST) -> Iterator[np.ndarray[Any, Any]]:
    """The arrays in a value, however deep they stand."""
    if isinstance(value, np.ndarray):
        yield value
    elif depth and isinstance(value, Mapping):
        for item in value.values():
            yield from arrays(item, depth - 1)
    elif depth and isinstance(value, list | tuple):
        for item in value:
            yield from arrays(item, depth - 1)


@dataclass(slots=True)
class Undo:
    """Contents of arrays before they were overwritten, as long as they aren't too large."""

    size_bytes: int = 0
    _before: list[tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]] = field(default_factory=list)

    def note(self, array: np.ndarray[Any, Any]) -> None:
        """Keeps what stands in the array."""
        if self.size_bytes + array.nbytes <= MOST_KEPT_BYTES:
            self.size_bytes += array.nbytes
            self._before.append((array, array.copy()))

    def undo(self) -> None:
        """Writes it back, the latest first."""
        while self._before:
            array, before = self._before.pop()
            if array.flags.writeable:
                array[...] = before
        self.size_bytes = 0


def overwrite(value: Any, undo: Undo | None = None) -> int:
    """Writes into every array of numbers that lets itself be written; says how many did.

    What was zero becomes one, all else zero: other values of the same type, whatever stood there.
    """
    count = 0
    for array in arrays(value):
        if array.flags.writeable and array.dtype.kind in NUMBERS and array.size:
            if undo is not None:
                undo.note(array)
            array[...] = array == 0
            count += 1
    return count


def share_memory(one: Any, other: Any) -> bool:
    """Tells whether writing numbers into an array of `one` changes one of `other`.

    An array without an axis is one value, that is replaced and not scaled in place.
    """
    return any(
        a.dtype.kind in NUMBERS
        and a.ndim > 0
        and a.flags.writeable
        and np.may_share_memory(a, b)
        and np.shares_memory(a, b)
        for a in arrays(one)
        for b in arrays(other)
    )


def spaces_in(env: Any) -> list[Any]:
    """Spaces that an environment and those inside its wrappers hold, by attribute or in tables."""
    found: list[Any] = []
    while env is not None and len(found) < MOST_SPACES:
        for value in vars(env).values():
            parts = value.values() if isinstance(value, dict) else (value,)
            found += [part for part in parts if isinstance(part, Space)]
        env = vars(env).get("env", vars(env).get("aec_env", vars(env).get("par_env")))
    return found
