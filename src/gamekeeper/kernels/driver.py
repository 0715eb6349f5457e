"""Drivers: what runs a kernel's rules over many copies, compiled or as plain Python.

Per-agent ends, horizon, autoreset and seeds are in `ticks` and `turns`, once; a kernel has only
rules.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from numpy.typing import NDArray

from gamekeeper.kernels.array_views import copy_of, places_of, plain_row
from gamekeeper.kernels.compile_cache import code_key, compiled, kernel_key, known
from gamekeeper.kernels.copy_steps import (
    clear_books,
    driver_of_one,
    tick_player,
    tick_shower,
    turn_keeper,
    turn_player,
    turn_shower,
)
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.kernel_arrays import Arrays
from gamekeeper.kernels.legality import judge_one
from gamekeeper.kernels.rule_parts import Parts
from gamekeeper.kernels.scalar_rules import Copy, numba


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
    loops = _all_loops(Parts(kernel, is_plain=False), copy_of(kernel))
    return Driver(*(compiled(each, kernel.name, code_key(each, kernel)) for each in loops))


def plain_driver(
    kernel: Kernel, records: NDArray[Any], tables: NDArray[Any], arrays: Arrays
) -> Driver:
    """The same over copies that plain Python can read; `places` mean nothing to it."""
    return Driver(*_all_loops(Parts(kernel, is_plain=True), plain_copy(records, tables, arrays)))


def plain_copy(records: NDArray[Any], tables: NDArray[Any], arrays: Arrays) -> Callable[..., Any]:
    """`copy(places, e)`: views of a batch's arrays for plain Python; `places` mean nothing."""
    t, states = _copies(tables)[0], _copies(records)
    rows = [plain_row(arrays, e) for e in range(len(records))]

    def copy(places: Any, e: int) -> Any:
        return states[e], t, rows[e]

    return copy


def _copies(records: NDArray[Any]) -> list[Copy]:
    return [Copy(records[e : e + 1].reshape(())) for e in range(len(records))]


def _all_loops(parts: Parts, copy: Callable[..., Any]) -> tuple[Any, ...]:
    begin_one, step_one = driver_of_one(parts)
    return (
        *_loops(copy, begin_one, step_one, judge_one(parts)),
        *_rare_loops(copy, begin_one, parts.rule("overview"), _show_one(parts)),
    )


def _loops(copy: Any, begin_one: Any, step_one: Any, judge: Any) -> tuple[Any, Any, Any]:
    def begin(places: Any, first: Any, last: Any, pool: Any, constant: Any, tells: Any) -> None:
        for e in range(first, last):
            s, t, a = copy(places, e)
            s.number = e
            begin_one(s, t, a, pool, constant, tells)

    def step(
        places: Any,
        first: Any,
        last: Any,
        pool: Any,
        constant: Any,
        slots: Any,
        is_next: Any,
        tells: Any,
    ) -> None:
        # `copy` makes views from addresses, which own nothing: a slice of an array would count its
        # references up and down, atomically, for every copy and field, and halve the speed.
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


def _show_one(parts: Parts) -> Any:
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


PAID, ENDED, JOINED = 1, 2, 4
SIGN_BITS: Final = 3
"""So many bits say what came of a step; above them stands how many words were drawn."""


@dataclass(frozen=True)
class Single:
    """Player of one sub-environment; each function takes what `given` says, then its arguments.

    Attributes:
        is_plain: as plain Python.
        start: `start(*given, seed, episode)`: begins an episode with that stream.
        play: `play(*given)`: a tick or turn with the action that stands in the arrays; returns the
            sum of PAID, ENDED and JOINED, and above these bits the number of words drawn.
        show_agent: `show_agent(*given, i)`: what agent i is given, into `final` and its
            neighbours. Of ticks `play` and `start` show it to all, in `obs`.
        overview: `overview(*given)`: fills the state that `state()` gives.
    """

    kernel: Kernel
    is_plain: bool
    start: Callable[..., None]
    play: Callable[..., int]
    show_agent: Callable[..., None]
    overview: Callable[..., None]

    def given(self, records: NDArray[Any], tables: NDArray[Any], arrays: Arrays) -> tuple[Any, ...]:
        """First arguments of the functions; valid as long as these arrays are."""
        if self.is_plain:
            found: tuple[Any, ...] = plain_copy(records, tables, arrays)(None, 0)
            return found
        return (places_of(records, tables, arrays),)

    def __reduce__(self) -> tuple[Any, ...]:
        """Functions are made anew."""
        return single_of, (self.kernel, self.is_plain)

    def __deepcopy__(self, memo: object) -> Single:
        """Functions are shared."""
        return self


def single_of(kernel: Kernel, is_plain: bool = False) -> Single:
    """Player of one sub-environment: compiled with Numba, or plain Python where asked for."""
    if is_plain or numba() is None:
        parts = Parts(kernel, is_plain=True)
        return Single(kernel, True, *_on_one(parts))
    key = kernel_key(kernel)
    functions = known(f"single {key}", lambda: _compiled_one(kernel))
    return Single(kernel, False, *functions)


def _compiled_one(kernel: Kernel) -> Any:
    loops = _on_places(copy_of(kernel), *_on_one(Parts(kernel, is_plain=False)))
    return [compiled(each, kernel.name, code_key(each, kernel)) for each in loops]


def _on_one(parts: Parts) -> tuple[Any, Any, Any, Any]:
    """The four functions over one copy's state, tables and views."""
    is_aec, count = parts.kernel.api == "aec", len(parts.kernel.agents)
    terms_count = len(parts.kernel.terms)
    reset, clear = parts.rule("reset"), clear_books(parts)
    play_one = turn_player(parts) if is_aec else tick_player(parts)
    show = parts.made(_no_show) if is_aec else tick_shower(parts)
    show_agent = turn_keeper(parts) if is_aec else parts.made(_show_no_agent)
    overview_one = parts.rule("overview")

    def start(s: Any, t: Any, a: Any, seed: Any, episode: Any) -> None:
        clear(a)
        limit = s.limit  # all else is cleared, as `copy_steps.begin_one` does
        for i in range(len(a.raw)):
            a.raw[i] = 0
        s.limit = limit
        s.seed = seed
        s.episode = episode
        s.block = -1
        for i in range(count):
            s.live[i] = 1
        reset(s, t)
        for i in range(count):
            a.live[i] = s.live[i] != 0
            if is_aec:
                s.due[i] = s.live[i]
        show(s, t, a, True, True)

    def play(s: Any, t: Any, a: Any) -> Any:
        clear(a)
        play_one(s, t, a)
        # One number comes back to Python, as every other array or tuple would be an object a step:
        # three bits of what happened, above them the draws, by which the caller moves its stream.
        found = s.draws << SIGN_BITS
        for i in range(count):
            if a.terminated[i] or a.truncated[i]:
                found |= ENDED
            for k in range(terms_count):
                if a.terms[i, k] != 0.0:
                    found |= PAID
            if s.live[i] != 0 and not a.live[i]:
                found |= JOINED
        show(s, t, a, True, True)
        return found

    def overview(s: Any, t: Any, a: Any) -> None:
        overview_one(s, t, a.state)

    return parts.made(start), parts.made(play), show_agent, parts.made(overview)


def _on_places(
    copy: Any, start_one: Any, play_one: Any, show_one_agent: Any, overview_one: Any
) -> Any:
    def start(places: Any, seed: Any, episode: Any) -> None:
        s, t, a = copy(places, 0)
        start_one(s, t, a, seed, episode)

    def play(places: Any) -> Any:
        s, t, a = copy(places, 0)
        return play_one(s, t, a)

    def show_agent(places: Any, i: Any) -> None:
        s, t, a = copy(places, 0)
        show_one_agent(s, t, a, i)

    def overview_of_one(places: Any) -> None:
        s, t, a = copy(places, 0)
        overview_one(s, t, a)

    return start, play, show_agent, overview_of_one


def _no_show(s: Any, t: Any, a: Any, tells: Any, is_after: Any) -> None:
    """Shows nothing: in turns the observation is asked for agent by agent."""


def _show_no_agent(s: Any, t: Any, a: Any, i: Any) -> None:
    """Shows nothing: in ticks all agents are shown at once."""
