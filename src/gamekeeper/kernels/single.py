"""The driver of one copy, for faces: rules and what they show, without episodes of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from numpy.typing import NDArray

from gamekeeper.kernels.arrays import Arrays
from gamekeeper.kernels.cache import compiled, known
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.keys import code_key, kernel_key
from gamekeeper.kernels.parts import Parts
from gamekeeper.kernels.places import copy_of, places_of
from gamekeeper.kernels.rows import plain_row
from gamekeeper.kernels.rules import Copy, numba
from gamekeeper.kernels.ticks import clear_books, shower
from gamekeeper.kernels.ticks import player as tick_player
from gamekeeper.kernels.turns import keeper
from gamekeeper.kernels.turns import player as turn_player

PAID, ENDED, JOINED = 1, 2, 4
SIGN_BITS: Final = 3
"""So many bits say what came of a step; above them stands how many words were drawn."""


@dataclass(frozen=True)
class Single:
    """What a face needs of one copy; each function takes what `given` says, then its arguments.

    Attributes:
        kernel: whose rules.
        is_plain: as plain Python.
        start: `start(*given, seed, episode)`: begins an episode with that stream.
        play: `play(*given)`: a tick or turn with the action that stands in the arrays; returns the
            sum of PAID, ENDED and JOINED, and above these bits the number of words drawn.
        look: `look(*given, i)`: what agent i is given, into `final` and its neighbours. Of ticks
            `play` and `start` show it to all, in `obs`.
        overview: `overview(*given)`: fills the state that `state()` gives.
    """

    kernel: Kernel
    is_plain: bool
    start: Callable[..., None]
    play: Callable[..., int]
    look: Callable[..., None]
    overview: Callable[..., None]

    def given(self, records: NDArray[Any], tables: NDArray[Any], arrays: Arrays) -> tuple[Any, ...]:
        """What the functions take first, of one copy; it lives as long as these arrays do."""
        if self.is_plain:
            return (
                Copy(records[0:1].reshape(())), Copy(tables[0:1].reshape(())), plain_row(arrays, 0)
            )  # fmt: skip
        return (places_of(records, tables, arrays),)

    def __reduce__(self) -> tuple[Any, ...]:
        """Functions are made anew."""
        return single_of, (self.kernel, self.is_plain)

    def __deepcopy__(self, memo: object) -> Single:
        """Functions are shared."""
        return self


def single_of(kernel: Kernel, is_plain: bool = False) -> Single:
    """What plays one copy: compiled where Numba is there, unless plain Python is asked for."""
    if is_plain or numba() is None:
        parts = Parts(kernel, is_plain=True)
        return Single(kernel, True, *_on_one(parts))
    key = kernel_key(kernel)
    functions = known(f"single {key}", lambda: _compiled(kernel))
    return Single(kernel, False, *functions)


def _compiled(kernel: Kernel) -> Any:
    loops = _on_places(copy_of(kernel), *_on_one(Parts(kernel, is_plain=False)))
    return [compiled(each, kernel.name, code_key(each, kernel)) for each in loops]


def _on_one(parts: Parts) -> tuple[Any, Any, Any, Any]:
    """The four functions over one copy's state, tables and views."""
    is_aec, count = parts.kernel.api == "aec", len(parts.kernel.agents)
    terms_count = len(parts.kernel.terms)
    reset, clear = parts.rule("reset"), clear_books(parts)
    play_one = turn_player(parts) if is_aec else tick_player(parts)
    show = parts.made(_no_show) if is_aec else shower(parts)
    look = keeper(parts) if is_aec else parts.made(_no_look)
    overview_one = parts.rule("overview")

    def start(s: Any, t: Any, a: Any, seed: Any, episode: Any) -> None:
        clear(a)
        limit = s.limit
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

    return parts.made(start), parts.made(play), look, parts.made(overview)


def _on_places(copy: Any, start_one: Any, play_one: Any, look_one: Any, overview_one: Any) -> Any:
    def start(places: Any, seed: Any, episode: Any) -> None:
        s, t, a = copy(places, 0)
        start_one(s, t, a, seed, episode)

    def play(places: Any) -> Any:
        s, t, a = copy(places, 0)
        return play_one(s, t, a)

    def look(places: Any, i: Any) -> None:
        s, t, a = copy(places, 0)
        look_one(s, t, a, i)

    def overview_of_one(places: Any) -> None:
        s, t, a = copy(places, 0)
        overview_one(s, t, a)

    return start, play, look, overview_of_one


def _no_show(s: Any, t: Any, a: Any, tells: Any, is_after: Any) -> None:
    """Of turns everybody is looked for alone."""


def _no_look(s: Any, t: Any, a: Any, i: Any) -> None:
    """Of ticks everybody is shown at once."""
