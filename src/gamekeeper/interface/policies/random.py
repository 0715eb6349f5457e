"""`random`: each legal action with the same probability."""

import copy
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Box, Discrete, Space
from numpy.random import Generator

from gamekeeper.episodes.exception_text import said_by
from gamekeeper.errors import PolicyError
from gamekeeper.interface.action_mask import Reader, for_sample, legal_flags, reader
from gamekeeper.interface.policy import AgentSlot, Player, Start, masks_blamed_on

VERSION: Final = "1"
"""Changes when the same seed would draw other actions."""

_TABLED: Final = 8192
"""Actions of a Discrete space whose values are made once instead of at every draw."""
_SHORT: Final = 64
"""Longest mask that is remembered; those of larger spaces hardly ever come again."""
_REMEMBERED: Final = 1024
"""Masks whose legal actions are remembered, for all agents of equal spaces."""


def start_for(given: AgentSlot) -> Start:
    """Draws from the agent's own stream, never from the environment's spaces.

    Masked Discrete and MultiDiscrete spaces: uniform over what is legal. A mask that leaves nothing
    is passed over. Values have the types that `space.sample()` gives.
    """
    space, read = given.space, reader(given.mask)
    if type(space) is Discrete and int(space.n) <= _TABLED:
        return _discrete(space, read, given)
    if type(space) is Box and np.issubdtype(space.dtype, np.floating) and space.is_bounded():
        return _bounded_box(space)
    return _by_sample(space, read, given)


def _discrete(space: Discrete, read: Reader, given: AgentSlot) -> Start:
    size, is_short = int(space.n), int(space.n) <= _SHORT
    actions, remembered = _tables(space, given.shared)

    def legal(mask: object, key: bytes | None) -> list[Any]:
        with masks_blamed_on(given, mask):
            flags = legal_flags(mask, size)
        found = [actions[i] for i in flags.nonzero()[0].tolist()] or actions
        if key is not None and len(remembered) < _REMEMBERED:
            remembered[key] = found
        return found

    def start(rng: Generator) -> Player:
        uniform = rng.random

        def play(observation: object, info: object) -> Any:
            mask = read(observation, info)
            if mask is None:
                return actions[int(uniform() * size)]
            key = _key(mask) if is_short else None
            choices = (key and remembered.get(key)) or legal(mask, key)
            # Off uniform by less than size * 2**-53, for a quarter of the cost of `integers`.
            return choices[int(uniform() * len(choices))]

        return play

    return start


def _tables(space: Discrete, shared: dict[Any, Any]) -> tuple[list[Any], dict[bytes, list[Any]]]:
    """All actions, and those legal under masks seen before; the same for agents of equal spaces."""
    size, first, scalar = int(space.n), int(space.start), space.dtype.type
    key = (__name__, size, first, scalar)
    if key not in shared:
        shared[key] = ([scalar(first + i) for i in range(size)], {})
    actions, remembered = shared[key]
    return actions, remembered


def _key(mask: object) -> bytes | None:
    """Key of a mask among those of one length: bytes of its integers by zero and not zero."""
    if type(mask) is np.ndarray:
        return mask.tobytes() if mask.ndim == 1 and mask.dtype.kind in "biu" else None
    return None


def _bounded_box(space: Box) -> Start:
    low, high = space.low.astype(np.float64), space.high.astype(np.float64)
    shape, dtype = space.shape, space.dtype
    with np.errstate(over="ignore"):
        span = high - low
    is_finite = bool(np.isfinite(span).all())

    def start(rng: Generator) -> Player:
        uniform = rng.random

        def play(observation: object, info: object) -> Any:
            drawn = uniform(shape)
            if is_finite:
                return np.asarray(low + span * drawn, dtype)
            return np.asarray(np.clip(low * (1 - drawn) + high * drawn, low, high), dtype)

        return play

    return start


def _by_sample(space: Space[Any], read: Reader, given: AgentSlot) -> Start:
    try:
        own = copy.deepcopy(space)
    except Exception as error:
        raise PolicyError(
            f"'random' can't copy the action space of {given.agent!r}",
            where=str(given.agent),
            actual=said_by(error),
            fix="give the agent a policy of your own",
        ) from error

    def start(rng: Generator) -> Player:
        own.seed(int(rng.integers(1 << 31)))

        def play(observation: object, info: object) -> Any:
            mask = read(observation, info)
            if mask is None:
                return own.sample()
            with masks_blamed_on(given, mask):
                return own.sample(mask=for_sample(own, mask))

        return play

    return start
