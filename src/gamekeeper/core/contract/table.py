"""Tables: mappings that never change, so that frozen data can hold named things."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Generic, TypeVar

V = TypeVar("V", covariant=True)


class Table(Mapping[str, V], Generic[V]):
    """An ordered mapping from names that can be hashed, copied and pickled, never changed.

    Two tables are equal where they hold the same rows, in whatever order, as in TOML.

    Args:
        rows: a mapping, or pairs of name and value.
    """

    __slots__ = ("_rows",)

    def __init__(self, rows: Mapping[str, V] | Iterable[tuple[str, V]] = ()) -> None:
        self._rows: dict[str, V] = dict(rows)

    def __getitem__(self, name: str) -> V:
        return self._rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __hash__(self) -> int:
        return hash(frozenset(self._rows.items()))

    def __repr__(self) -> str:
        return f"Table({self._rows!r})"

    def __reduce__(self) -> tuple[type[Table[V]], tuple[dict[str, V]]]:
        return type(self), (self._rows,)
