"""A sequence whose items are made when they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar, overload

T = TypeVar("T", covariant=True)


class Views(Sequence[T]):
    """Read-only views of rows, made anew at each access and not kept.

    Args:
        count: number of items.
        make: makes the item at a place from 0 to count - 1.
        walk: makes all in their order, where that is cheaper than one by one.
    """

    __slots__ = ("_count", "_make", "_walk")

    def __init__(
        self, count: int, make: Callable[[int], T], walk: Callable[[], Iterator[T]] | None = None
    ) -> None:
        self._count, self._make, self._walk = count, make, walk

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, place: int) -> T: ...
    @overload
    def __getitem__(self, place: slice) -> Views[T]: ...
    def __getitem__(self, place: int | slice) -> T | Views[T]:
        places = range(self._count)[place]
        if isinstance(places, int):
            return self._make(places)
        return Views(len(places), lambda at: self._make(places[at]))

    def __iter__(self) -> Iterator[T]:
        return map(self._make, range(self._count)) if self._walk is None else self._walk()

    def __repr__(self) -> str:
        return f"<Views: {self._count} items>"
