"""A ring of preallocated slots for large observations on their way from the step to the writer."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.core.tape import Place

MEMORY_BYTES: Final = 64 << 20  # of one ring, unless a few slots need more
FEWEST: Final = 2  # slots, however large: one is filled while the other is written
MOST: Final = 8192  # slots, however small
SLOT_BITS: Final = 24


class Ring:
    """Slots laid out like the source's memory, so that putting an array aside is one memory copy.

    The step puts, the writer opens and frees. The slot freed last is used first, so that memory is
    touched only as far as the writer lags behind.
    """

    def __init__(self, like: NDArray[Any]) -> None:
        """Allocates slots for arrays of the dtype, shape and axis order of `like`."""
        count = max(FEWEST, min(MOST, MEMORY_BYTES // max(like.nbytes, 1)))
        axes = sorted(range(like.ndim), key=lambda axis: -abs(like.strides[axis]))
        raw = np.empty((count, *(like.shape[axis] for axis in axes)), like.dtype)
        back = np.argsort(axes)
        self._slots = [slot.transpose(back) for slot in raw]
        self._free = list(range(count))

    def put(self, array: NDArray[Any]) -> int | None:
        """Copies `array` into a free slot and returns its number; None if there is none."""
        try:
            slot = self._free.pop()
        except IndexError:
            return None
        np.copyto(self._slots[slot], array)
        return slot

    def copy(self, slot: int) -> bytes:
        """The C bytes of `slot`, which stays taken."""
        data: bytes = self._slots[slot].tobytes()
        return data

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

    def put(self, array: NDArray[Any]) -> Place | None:
        """Puts `array` aside and returns its place; None if its ring is full."""
        kind = (array.dtype, array.shape)
        number = self._by_kind.get(kind)
        if number is None:
            number = len(self._rings)
            self._rings.append(Ring(array))
            self._by_kind[kind] = number
        slot = self._rings[number].put(array)
        return None if slot is None else Place(number << SLOT_BITS | slot)

    def copy(self, place: int) -> bytes:
        """The C bytes of the array at `place`, which stays taken."""
        return self._rings[place >> SLOT_BITS].copy(place & (1 << SLOT_BITS) - 1)

    def release(self, place: int) -> None:
        """Frees a place whose array nobody will open."""
        self._rings[place >> SLOT_BITS].release(place & (1 << SLOT_BITS) - 1)

    def open(self, place: int, out: NDArray[np.uint8]) -> None:
        """Writes the C bytes of the array at `place` into `out`, [bytes], and frees the place."""
        self._rings[place >> SLOT_BITS].open(place & (1 << SLOT_BITS) - 1, out)
