"""The arrays of a vector environment in one piece of memory, which processes may share."""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

Arrays: TypeAlias = Mapping[str, NDArray[Any]]
Plan: TypeAlias = Sequence[tuple[str, Sequence[int], str]]
"""Name, shape and dtype of every array."""

ALIGNMENT: Final = 64
"""Bytes; a line of the cache, so that no two arrays share one."""


def size_of(plan: Plan) -> int:
    """How many bytes all arrays of a plan take."""
    return sum(_padded(shape, dtype) for _, shape, dtype in plan)


def arrays_in(memory: Any, plan: Plan) -> dict[str, NDArray[Any]]:
    """The arrays of a plan as views of `memory`."""
    found: dict[str, NDArray[Any]] = {}
    offset = 0
    for name, shape, dtype in plan:
        count = int(np.prod(shape, dtype=np.int64))
        view = np.frombuffer(memory, dtype, count, offset) if count else np.empty(0, dtype)
        found[name] = view.reshape(tuple(shape))
        offset += _padded(shape, dtype)
    return found


def own_memory(plan: Plan) -> bytearray:
    """Memory of this process alone, zeros."""
    return bytearray(max(size_of(plan), 1))


def _padded(shape: Sequence[int], dtype: str) -> int:
    size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
    return -(-size // ALIGNMENT) * ALIGNMENT


class SharedMemory:
    """Memory without a name: it goes with the last process that holds it, however that ends.

    A child gets it by inheriting the descriptor. On Linux it is a memfd, elsewhere a file that is
    deleted as soon as it is open.
    """

    __slots__ = ("fd", "memory", "size")

    def __init__(self, size: int) -> None:
        """Makes `size` bytes of zeros."""
        self.size = max(size, 1)
        if hasattr(os, "memfd_create"):
            self.fd = os.memfd_create("gamekeeper-vector")
        else:
            with tempfile.TemporaryFile() as file:
                self.fd = os.dup(file.fileno())
        os.ftruncate(self.fd, self.size)
        self.memory = mmap.mmap(self.fd, self.size)

    def close(self) -> None:
        """Lets go of the descriptor; the memory goes once no array looks at it any more."""
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1


def attached(fd: int, size: int) -> mmap.mmap:
    """The memory behind an inherited descriptor."""
    return mmap.mmap(fd, size)


def part(arrays: Arrays, envs: slice) -> dict[str, NDArray[Any]]:
    """The arrays of some of the copies."""
    return {name: array[envs] for name, array in arrays.items()}
