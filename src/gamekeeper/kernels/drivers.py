"""Drivers: what runs a kernel's rules over many copies, compiled or as plain Python.

Per-agent ends, horizon, autoreset and seeds are in `ticks` and `turns`, once; a kernel has only
rules.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gamekeeper.kernels.arrays import Arrays
from gamekeeper.kernels.cache import compiled
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.parts import Parts
from gamekeeper.kernels.rows import plain_row
from gamekeeper.kernels.rules import Copy, numba
from gamekeeper.kernels.ticks import tick_driver
from gamekeeper.kernels.turns import turn_driver


@dataclass(frozen=True)
class Driver:
    """Two functions over batches; arrays are overwritten.

    Attributes:
        begin: `begin(records, tables, arrays, pool, constant, first, tells)`: every copy begins
            its first episode, copy e episode first + e.
        step: `step(records, tables, arrays, pool, constant, slots, is_next, tells)`: one step of
            every copy; who ends begins episode number + slots. `tells`: infos are filled.
    """

    begin: Callable[..., None]
    step: Callable[..., None]


def driver_of(kernel: Kernel, *, is_plain: bool = False) -> Driver:
    """The driver of a kernel: compiled where Numba is there, unless plain Python is asked for."""
    parts = Parts(kernel, is_plain=is_plain or numba() is None)
    one = turn_driver(parts) if kernel.api == "aec" else tick_driver(parts)
    if parts.is_plain:
        return _plain(*one)
    begin, step = _loops(parts, *one)
    return Driver(compiled(begin, kernel.name), compiled(step, kernel.name))


def _loops(parts: Parts, begin_one: Any, step_one: Any) -> tuple[Any, Any]:
    row = parts.row

    def begin(
        records: Any, tables: Any, a: Any, pool: Any, constant: Any, first: Any, tells: Any
    ) -> None:
        t = tables[0]
        for e in range(len(records)):
            s = records[e]
            s.number = first + e
            begin_one(s, t, row(a, e), pool, constant, tells)

    def step(
        records: Any, tables: Any, a: Any,
        pool: Any, constant: Any, slots: Any, is_next: Any, tells: Any,
    ) -> None:  # fmt: skip
        t = tables[0]
        for e in range(len(records)):
            end = step_one(
                records[e], t, row(a, e), a.over[e], pool, constant, slots, is_next, tells
            )
            a.ended[e] = end != 0
            a.over[e] = end > 1

    return begin, step


def _plain(begin_one: Any, step_one: Any) -> Driver:
    """The same loops over copies that plain Python can read."""

    def begin(
        records: Any, tables: Any, a: Arrays, pool: int, constant: int, first: int, tells: bool
    ) -> None:
        t = copies(tables)[0]
        for e, s in enumerate(copies(records)):
            s.number = first + e
            begin_one(s, t, plain_row(a, e), pool, constant, tells)

    def step(records: Any, tables: Any, a: Arrays, *rest: Any) -> None:
        t = copies(tables)[0]
        for e, s in enumerate(copies(records)):
            end = step_one(s, t, plain_row(a, e), bool(a.over[e]), *rest)
            a.ended[e] = end != 0
            a.over[e] = end > 1

    return Driver(begin, step)


def copies(records: NDArray[Any]) -> list[Copy]:
    """The copies of a batch as plain Python sees them."""
    return [Copy(records[e : e + 1].reshape(())) for e in range(len(records))]


def tables_of(kernel: Kernel) -> NDArray[Any]:
    """The kernel's tables as an array of one record; of a kernel without any, an empty record's."""
    if kernel.tables is None:
        return np.zeros(1, np.dtype([("nothing", "i1")]))
    tables: NDArray[Any] = kernel.tables.reshape(1)
    return tables
