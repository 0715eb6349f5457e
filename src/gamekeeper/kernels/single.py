"""The driver of one copy, for faces: rules and what they show, without episodes of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from gamekeeper.kernels.cache import compiled
from gamekeeper.kernels.drivers import copies
from gamekeeper.kernels.kernel import Kernel
from gamekeeper.kernels.keys import kernel_key
from gamekeeper.kernels.parts import Parts
from gamekeeper.kernels.rows import plain_row
from gamekeeper.kernels.rules import numba
from gamekeeper.kernels.ticks import clear_books, shower
from gamekeeper.kernels.ticks import player as tick_player
from gamekeeper.kernels.turns import keeper
from gamekeeper.kernels.turns import player as turn_player

PAID, ENDED, JOINED = 1, 2, 4
SIGNS: Final = 1 << 64


@dataclass(frozen=True)
class Single:
    """What a face needs of one copy; all work on arrays of one copy.

    Attributes:
        start: `start(records, tables, arrays, seed, episode)`: begins an episode with that stream.
        play: `play(records, tables, arrays)`: a tick or turn with the action that stands in the
            arrays; returns the sum of PAID, ENDED and JOINED.
        look: `look(records, tables, arrays, i)`: what agent i is given, into `final` and its
            neighbours. Of ticks `play` and `start` show it to all, in `obs`.
        overview: `overview(records, tables, out)`: the state that `state()` gives.
    """

    start: Callable[..., None]
    play: Callable[..., int]
    look: Callable[..., None]
    overview: Callable[..., None]

    def __deepcopy__(self, memo: object) -> Single:
        """Functions are shared."""
        return self


def single_of(kernel: Kernel, *, is_plain: bool = False) -> Single:
    """What plays one copy: compiled where Numba is there, unless plain Python is asked for."""
    parts = Parts(kernel, is_plain=is_plain or numba() is None)
    start, play, look, overview = _on_one(parts)
    if parts.is_plain:
        return Single(_plain(start), _plain(play), _plain(look), _plain_overview(overview))
    loops = _loops(parts, start, play, look, overview)
    return Single(*(compiled(each, kernel.name, kernel_key(kernel)) for each in loops))


def _on_one(parts: Parts) -> tuple[Any, Any, Any, Any]:
    """The four functions over one copy's state and views."""
    is_aec, count = parts.kernel.api == "aec", len(parts.kernel.agents)
    terms_count = len(parts.kernel.terms)
    reset, clear = parts.rule("reset"), clear_books(parts)
    play_one = turn_player(parts) if is_aec else tick_player(parts)
    show = parts.made(_no_show) if is_aec else shower(parts)
    look = keeper(parts) if is_aec else parts.made(_no_look)

    def start(s: Any, t: Any, a: Any, seed: Any, episode: Any) -> None:
        clear(a)
        for i in range(len(a.raw)):
            a.raw[i] = 0
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
        found = 0
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

    return parts.made(start), parts.made(play), look, parts.rule("overview")


def _loops(parts: Parts, start_one: Any, play_one: Any, look_one: Any, overview_one: Any) -> Any:
    row = parts.row

    def start(records: Any, tables: Any, a: Any, seed: Any, episode: Any) -> None:
        start_one(records[0], tables[0], row(a, 0), seed, episode)

    def play(records: Any, tables: Any, a: Any) -> Any:
        return play_one(records[0], tables[0], row(a, 0))

    def look(records: Any, tables: Any, a: Any, i: Any) -> None:
        look_one(records[0], tables[0], row(a, 0), i)

    def overview(records: Any, tables: Any, out: Any) -> None:
        overview_one(records[0], tables[0], out)

    return start, play, look, overview


def _plain(function: Any) -> Any:
    def on_arrays(records: Any, tables: Any, a: Any, *rest: Any) -> Any:
        return function(copies(records)[0], copies(tables)[0], plain_row(a, 0), *rest)

    return on_arrays


def _plain_overview(function: Any) -> Any:
    def overview(records: Any, tables: Any, out: Any) -> None:
        function(copies(records)[0], copies(tables)[0], out)

    return overview


def _no_show(s: Any, t: Any, a: Any, tells: Any, is_after: Any) -> None:
    """Of turns everybody is looked for alone."""


def _no_look(s: Any, t: Any, a: Any, i: Any) -> None:
    """Of ticks everybody is shown at once."""
