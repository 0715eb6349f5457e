"""A ring of preallocated slots for large observations on their way from the step to the writer."""

from __future__ import annotations

import time
from collections import deque
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.core.tape import Place

MEMORY_BYTES: Final = 64 << 20  # of one ring, unless a few slots need more
FEWEST: Final = 64
SLOT_BITS: Final = 24
PATIENCE_S: Final = 0.0005  # between looks for a free slot, while the writer catches up


class Ring:
    """Slots laid out like the source's memory, so that putting an array aside is one memory copy.

    The step puts, the writer opens and frees; a full ring holds the step back until a slot is free.
    """

    def __init__(self, like: NDArray[Any]) -> None:
        """Allocates slots for arrays of the dtype, shape and axis order of `like`."""
        count = max(FEWEST, MEMORY_BYTES // max(like.nbytes, 1))
        axes = sorted(range(like.ndim), key=lambda axis: -abs(like.strides[axis]))
        raw = np.empty((count, *(like.shape[axis] for axis in axes)), like.dtype)
        back = np.argsort(axes)
        self._slots = [slot.transpose(back) for slot in raw]
        self._free = deque(range(count))

    def put(self, array: NDArray[Any]) -> int:
        """Copies `array` into a free slot and returns its number; waits while there is none."""
        while True:
            try:
                slot = self._free.popleft()
            except IndexError:
                time.sleep(PATIENCE_S)
            else:
                np.copyto(self._slots[slot], array)
                return slot

    def open(self, slot: int, out: NDArray[np.uint8]) -> None:
        """Writes the C bytes of `slot` into `out`, [bytes], and frees the slot."""
        source = self._slots[slot]
        np.copyto(out.view(source.dtype).reshape(source.shape), source)
        self._free.append(slot)

    def release(self, slot: int) -> None:
        """Frees `slot` unopened."""
        self._free.append(slot)


class Rings:
    """One ring for each kind of array; a place is the number of the ring and of its slot in one."""

    def __init__(self) -> None:
        self._rings: list[Ring] = []
        self._by_kind: dict[tuple[Any, tuple[int, ...]], int] = {}

    def put(self, array: NDArray[Any]) -> Place:
        """Puts `array` aside and returns its place."""
        kind = (array.dtype, array.shape)
        number = self._by_kind.get(kind)
        if number is None:
            number = self._by_kind[kind] = len(self._rings)
            self._rings.append(Ring(array))
        return Place(number << SLOT_BITS | self._rings[number].put(array))

    def release(self, place: int) -> None:
        """Frees a place whose array nobody will open."""
        self._rings[place >> SLOT_BITS].release(place & (1 << SLOT_BITS) - 1)

    def open(self, place: int, out: NDArray[np.uint8]) -> None:
        """Writes the C bytes of the array at `place` into `out`, [bytes], and frees the place."""
        self._rings[place >> SLOT_BITS].open(place & (1 << SLOT_BITS) - 1, out)
