"""Other randomness in the middle of a play: every generator that an environment holds, reseeded."""

from __future__ import annotations

import random
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any, Final

import numpy as np

from gamekeeper.core.stream import Stream
from gamekeeper.game.capture.stillness import generators, state_of

APART: Final = 1 << 24
"""Draws between two stretches of a counter-based stream."""


def reseed(env: Any, number: int) -> None:
    """Gives every generator that `env` holds, and the global ones, another future.

    Equal numbers give equal futures; a generator that only foreign code holds isn't reached.

    Args:
        number: in [0, 2**31).
    """
    for place, generator in enumerate(generators(env)):
        _reseed(generator, number, place)


def reseed_some(env: Any, number: int, places: Collection[int]) -> None:
    """As `reseed`, but only those generators that `standing` tells of at these places."""
    for place, generator in enumerate(generators(env)):
        if place in places:
            _reseed(generator, number, place)


def standing(env: Any) -> list[Any]:
    """Where every generator stands that `env` holds, and the global ones; None: it doesn't say."""
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


@contextmanager
def kept_global_generators() -> Iterator[None]:
    """What is drawn or reseeded within leaves Python's and numpy's global generators as before."""
    states = random.getstate(), np.random.get_state()  # the global one is meant
    try:
        yield
    finally:
        random.setstate(states[0])
        np.random.set_state(states[1])
