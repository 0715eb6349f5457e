"""Drivers: what runs a kernel's rules over many copies, compiled or as plain Python.

Per-agent ends, horizon, autoreset and seeds are in `ticks` and `turns`, once; a kernel has only
rules.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from gamekeeper.kernels.arrays import Arrays
from gamekeeper.kernels.cache import compiled, known
from gamekeeper.kernels.judge import judge_one
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.keys import code_key, kernel_key
from gamekeeper.kernels.parts import Parts
from gamekeeper.kernels.places import copy_of
from gamekeeper.kernels.places import tables_of as tables_of
from gamekeeper.kernels.rows import plain_row
from gamekeeper.kernels.rules import Copy
from gamekeeper.kernels.ticks import shower as tick_shower
from gamekeeper.kernels.ticks import tick_driver
from gamekeeper.kernels.turns import shower as turn_shower
from gamekeeper.kernels.turns import turn_driver


@dataclass(frozen=True)
class Driver:
    """Functions over the copies `first` to before `last` of a batch; its arrays are overwritten.

    `places` are what `places_of` gives, `pool` and `constant` those of the run's `EpisodeSeeds`,
    `tells` says whether infos are filled.

    Attributes:
        begin: `begin(places, first, last, pool, constant, tells)`: every copy begins its first
            episode, copy e episode e.
        step: `step(places, first, last, pool, constant, slots, is_next, tells)`: one step of every
            copy; who ends begins episode number + slots.
        judge: `judge(places, first, last)`: whether all actions are legal.
        restart: `restart(places, first, last, pool, constant, slots, tells)`: who is over begins
            episode number + slots.
        overview: `overview(places, first, last)`: fills the states that `state()` gives.
        show: `show(places, first, last, tells)`: shows the copies as they are; who is without a
            live agent is over.
    """

    begin: Callable[..., None]
    step: Callable[..., None]
    judge: Callable[..., bool]
    restart: Callable[..., None]
    overview: Callable[..., None]
    show: Callable[..., None]


def driver_of(kernel: Kernel) -> Driver:
    """The compiled driver of a kernel; the same one for kernels that are alike."""
    key = kernel_key(kernel)
    driver: Driver = known(f"driver {key}", lambda: _compiled(kernel))
    return driver


def _compiled(kernel: Kernel) -> Driver:
    parts = Parts(kernel, is_plain=False)
    one = turn_driver(parts) if kernel.api == "aec" else tick_driver(parts)
    copy = copy_of(kernel)
    loops = (
        *_loops(copy, *one, judge_one(parts)),
        *_rare_loops(copy, one[0], parts.rule("overview"), show_one(parts)),
    )
    return Driver(*(compiled(each, kernel.name, code_key(each, kernel)) for each in loops))


def _loops(copy: Any, begin_one: Any, step_one: Any, judge: Any) -> tuple[Any, Any, Any]:
    def begin(places: Any, first: Any, last: Any, pool: Any, constant: Any, tells: Any) -> None:
        for e in range(first, last):
            s, t, a = copy(places, e)
            s.number = e
            begin_one(s, t, a, pool, constant, tells)

    def step(
        places: Any, first: Any, last: Any,
        pool: Any, constant: Any, slots: Any, is_next: Any, tells: Any,
    ) -> None:  # fmt: skip
        for e in range(first, last):
            s, t, a = copy(places, e)
            end = step_one(s, t, a, a.over[()], pool, constant, slots, is_next, tells)
            a.ended[()] = end != 0
            a.over[()] = end > 1

    def judge_all(places: Any, first: Any, last: Any) -> Any:
        is_fine = True
        for e in range(first, last):
            _, _, a = copy(places, e)
            is_fine &= judge(a, a.over[()])
        return is_fine

    return begin, step, judge_all


def show_one(parts: Parts) -> Any:
    """`show(s, t, a, tells)`: what is given now; whether nobody is live any more."""
    is_aec, count = parts.kernel.api == "aec", len(parts.kernel.agents)
    show = turn_shower(parts) if is_aec else tick_shower(parts)

    def show_now(s: Any, t: Any, a: Any, tells: Any) -> Any:
        is_over = True
        for i in range(count):
            a.live[i] = s.live[i] != 0
            is_over &= s.live[i] == 0
        show(s, t, a, tells, is_aec and is_over)
        return is_over

    return parts.made(show_now)


def _rare_loops(copy: Any, begin_one: Any, overview_one: Any, show: Any) -> tuple[Any, Any, Any]:
    def restart(
        places: Any, first: Any, last: Any, pool: Any, constant: Any, slots: Any, tells: Any
    ) -> None:
        for e in range(first, last):
            s, t, a = copy(places, e)
            if a.over[()]:
                s.number += slots
                begin_one(s, t, a, pool, constant, tells)
                a.over[()] = False

    def overview(places: Any, first: Any, last: Any) -> None:
        for e in range(first, last):
            s, t, a = copy(places, e)
            overview_one(s, t, a.state)

    def show_all(places: Any, first: Any, last: Any, tells: Any) -> None:
        for e in range(first, last):
            s, t, a = copy(places, e)
            a.over[()] = show(s, t, a, tells)

    return restart, overview, show_all


def plain_driver(
    kernel: Kernel, records: NDArray[Any], tables: NDArray[Any], arrays: Arrays
) -> Driver:
    """The same over copies that plain Python can read; `places` mean nothing to it."""
    parts = Parts(kernel, is_plain=True)
    begin_one, step_one = turn_driver(parts) if kernel.api == "aec" else tick_driver(parts)
    judge_a = judge_one(parts)
    t, found = copies(tables)[0], copies(records)
    rows = [plain_row(arrays, e) for e in range(len(records))]

    def begin(places: Any, first: int, last: int, *rest: Any) -> None:
        for e in range(first, last):
            found[e].number = e
            begin_one(found[e], t, rows[e], *rest)

    def step(places: Any, first: int, last: int, *rest: Any) -> None:
        for e in range(first, last):
            end = step_one(found[e], t, rows[e], bool(arrays.over[e]), *rest)
            arrays.ended[e] = end != 0
            arrays.over[e] = end > 1

    def judge(places: Any, first: int, last: int) -> bool:
        return all(judge_a(rows[e], bool(arrays.over[e])) for e in range(first, last))

    def restart(
        places: Any, first: int, last: int, pool: int, constant: int, slots: int, tells: bool
    ) -> None:
        for e in range(first, last):
            if arrays.over[e]:
                found[e].number += slots
                begin_one(found[e], t, rows[e], pool, constant, tells)
                arrays.over[e] = False

    overview_one = parts.rule("overview")

    def overview(places: Any, first: int, last: int) -> None:
        for e in range(first, last):
            overview_one(found[e], t, rows[e].state)

    show_row = show_one(parts)

    def show(places: Any, first: int, last: int, tells: bool) -> None:
        for e in range(first, last):
            arrays.over[e] = show_row(found[e], t, rows[e], tells)

    return Driver(begin, step, judge, restart, overview, show)


def copies(records: NDArray[Any]) -> list[Copy]:
    """The copies of a batch as plain Python sees them."""
    return [Copy(records[e : e + 1].reshape(())) for e in range(len(records))]
