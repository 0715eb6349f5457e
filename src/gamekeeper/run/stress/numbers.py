"""The numbers of one part of an observation or action, read and written in its own types."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete, MultiBinary, MultiDiscrete, Space
from numpy.typing import NDArray

from gamekeeper.run.stress.part import Part, scalar_like

Floats = NDArray[np.float64]

WIDEST: Final = 1e9
"""Bounds that are further apart are none: the ends of a dtype, as many spaces have them."""


class Numbers:
    """Reads the numbers of a part out of a value, and gives the value with others in their place.

    Attributes:
        part: where they stand.
        size: how many there are.
        low: [size] the least that the space allows, minus infinity where nothing is declared.
        high: [size] the greatest, likewise.
        width: [size] how far they can lie apart: as declared, or, where no bounds are, how far
            apart those that were read so far have been, 0 counted as one of them.
    """

    def __init__(self, part: Part) -> None:
        low, high = _bounds(part.space)
        self.part = part
        place = slice(None) if part.numbers is None else part.numbers
        self._place = list(place) if isinstance(place, tuple) else place
        self.low, self.high = low[self._place], high[self._place]
        self.size = int(self.low.size)
        with np.errstate(over="ignore", invalid="ignore"):
            span = self.high - self.low
        self.is_bounded = np.isfinite(span) & (span <= WIDEST)
        self.width = np.where(self.is_bounded, span, 0.0)
        self._least, self._most = np.zeros(self.size), np.zeros(self.size)
        self._is_all_bounded = bool(self.is_bounded.all())

    def read(self, whole: Any) -> Floats | None:
        """[size] the numbers; None where the value hasn't the declared form."""
        value = self.part.of(whole)
        if not isinstance(value, np.ndarray | np.generic | int | float | list):
            return None
        try:
            array = np.asarray(value)
        except ValueError:  # a list of lists that have different lengths
            return None
        if array.shape != self.part.space.shape or array.dtype.kind not in "biuf":
            return None
        found = array.reshape(-1)[self._place].astype(np.float64)
        if not self._is_all_bounded:
            self._widen(found)
        return found

    def write(self, whole: Any, numbers: Floats) -> Any:
        """The value with these numbers, rounded where they are whole, kept in the space."""
        value = self.part.of(whole)
        kept = np.minimum(np.maximum(numbers, self.low), self.high)  # np.clip takes twice as long
        array = np.array(value, order="C")
        if array.dtype.kind in "biu":
            kept = np.rint(kept)
        array.reshape(-1)[self._place] = kept.astype(array.dtype)
        if isinstance(value, np.ndarray):
            return self.part.put(whole, array)
        return self.part.put(
            whole, array.tolist() if isinstance(value, list) else scalar_like(value, kept[0])
        )

    def blank(self) -> Floats:
        """[size] zeros, or what the space allows that is nearest to them."""
        return np.clip(np.zeros(self.size), self.low, self.high)

    def _widen(self, found: Floats) -> None:
        finite = np.where(np.isfinite(found), found, 0.0)
        self._least = np.minimum(self._least, finite)
        self._most = np.maximum(self._most, finite)
        self.width = np.where(self.is_bounded, self.width, self._most - self._least)


def _bounds(space: Space[Any]) -> tuple[Floats, Floats]:
    if isinstance(space, Box):
        return _flat(space.low), _flat(space.high)
    if isinstance(space, Discrete):
        return _flat(space.start), _flat(space.start + space.n - 1)
    if isinstance(space, MultiDiscrete):
        return _flat(space.start), _flat(space.start + space.nvec - 1)
    count = int(np.prod(space.shape or ()))
    return np.zeros(count), np.ones(count)


def _flat(numbers: Any) -> Floats:
    return np.asarray(numbers).reshape(-1).astype(np.float64)


def are_numbers(space: Space[Any]) -> bool:
    """Whether what stands in a space is numbers."""
    return isinstance(space, Box | Discrete | MultiBinary | MultiDiscrete)


def numbers_of(parts: Iterable[Part]) -> list[Numbers]:
    """Those parts that are numbers, and have any."""
    found = [Numbers(part) for part in parts if are_numbers(part.space)]
    return [each for each in found if each.size]
