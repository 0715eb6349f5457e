"""Randomness around an environment: global generators, its own ones, and the time of day."""

import random
import sys
import time
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

import numpy as np

from gamekeeper.interface.generators import generators, state_of
from gamekeeper.randomness.stream import Stream

# -- The generators that all of a process shares: numpy.random, random, torch where it is loaded

HELD: Final = 764_309
"""A seed that nobody is likely to take too, so that seeding anew is always a change."""


def states() -> dict[str, Any]:
    """The state of each, comparable with `==`, by the name of its module."""
    name, keys, *rest = np.random.get_state(legacy=True)
    found: dict[str, Any] = {
        "numpy.random": (name, np.asarray(keys).tobytes(), *rest),
        "random": random.getstate(),
    }
    torch = sys.modules.get("torch")
    if torch is not None and hasattr(torch, "get_rng_state"):
        found["torch"] = torch.get_rng_state().numpy().tobytes()
    return found


def restore(kept: Mapping[str, Any]) -> None:
    """Puts the states back that `states` gave."""
    name, keys, *rest = kept["numpy.random"]
    np.random.set_state((name, np.frombuffer(keys, np.uint32), *rest))
    random.setstate(kept["random"])
    torch = sys.modules.get("torch")
    if torch is not None and "torch" in kept:
        torch.set_rng_state(torch.from_numpy(np.frombuffer(kept["torch"], np.uint8).copy()))


def seed_all(seed: int) -> None:
    """Seeds each of them."""
    np.random.seed(seed)
    random.seed(seed)
    torch = sys.modules.get("torch")
    if torch is not None and hasattr(torch, "manual_seed"):
        torch.manual_seed(seed)


@contextmanager
def kept_global_generators() -> Iterator[None]:
    """Restores them after draws or reseeding within."""
    kept = states()
    try:
        yield
    finally:
        restore(kept)


@contextmanager
def held(seed: int = HELD) -> Iterator[None]:
    """Within it they start from one seed; afterwards they are as they were before."""
    with kept_global_generators():
        seed_all(seed)
        yield


# -- Other randomness in the middle of an episode: every generator that an environment holds,
# reseeded

APART: Final = 1 << 24
"""Draws between two stretches of a counter-based stream."""


def reseed(env: Any, number: int, places: Collection[int] | None = None) -> None:
    """Gives every generator that `env` holds, and the global ones, another future.

    Equal numbers give equal futures; a generator that only foreign code holds isn't reached.

    Args:
        number: in [0, 2**31).
        places: only those generators that `standing` tells of at these places; None: all.
    """
    for place, generator in enumerate(generators(env)):
        if places is None or place in places:
            _reseed(generator, number, place)


def rekey(found: Iterable[Any], number: int) -> None:
    """As `reseed`, for generators that were found before; lanes forked off a stream follow it."""
    for place, generator in enumerate(found):
        if isinstance(generator, Stream):
            generator.leave(number)
        else:
            _reseed(generator, number, place)


def standing(env: Any) -> list[Any]:
    """States of all generators that `env` holds, and of the global ones; None: it doesn't say."""
    found = []
    for generator in generators(env):
        try:
            found.append(state_of(generator))
        except NotImplementedError:  # random.SystemRandom stands nowhere
            found.append(None)
    return found


def _reseed(generator: Any, number: int, place: int) -> None:
    seed = (number * 1_000_003 + place) % (1 << 31)
    if isinstance(generator, np.random.Generator):
        generator.bit_generator.state = type(generator.bit_generator)(seed).state
    elif isinstance(generator, Stream):
        generator.draws = (number + 1) * APART
    else:
        generator.seed(seed)


# -- Another time of day, for those who take it for randomness

LATER_S: Final = (1009, 86_413)
"""Seconds that the clock is moved within `later`: two, as two of few outcomes may agree."""
NS: Final = 1_000_000_000


@contextmanager
def later(seconds: int) -> Iterator[None]:
    """Within it `time.time()` and `time.time_ns()` are ahead; who holds the functions isn't led on.

    Clocks that only measure how long something took go on as they are.
    """
    now, now_ns = time.time, time.time_ns
    time.time = lambda: now() + seconds
    time.time_ns = lambda: now_ns() + seconds * NS
    try:
        yield
    finally:
        time.time, time.time_ns = now, now_ns
