"""Moves of a play as its agents see them, how long a play may be, and other legal actions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from gymnasium.spaces import Discrete

from gamekeeper.auditing.probe_session import ProbeSession
from gamekeeper.episodes.canonical import to_json
from gamekeeper.episodes.episode import Episode

LEAST_TURNS: Final = 8
FILM_BYTES: Final = 32 << 20
"""Observations of one play, as far as a probe that plays a handful of times keeps them."""


def moves(trace: Episode) -> int:
    """The number of turns at which some agent observed something else than it last did."""
    seen: dict[str, Any] = {}
    count = 0
    for turn in trace.turns:
        now = turn.observations
        count += any(agent in seen and not equal(seen[agent], now[agent]) for agent in now)
        seen.update(now)
    return count


def equal(one: Any, other: Any) -> bool:
    """Tells whether two observations are equal bit for bit."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and one.dtype != object:
        is_alike = one.dtype == other.dtype and one.shape == other.shape
        return is_alike and one.tobytes() == other.tobytes()
    return to_json(one) == to_json(other)


def affordable(lab: ProbeSession, turns: int, size_bytes: int = FILM_BYTES) -> int:
    """So many turns, or fewer where observations are large; eight at least."""
    sizes = [_size(spec.observation_space) for spec in lab.agents.values()]
    each = max(sizes, default=0) if lab.api == "aec" else sum(sizes)
    return max(min(turns, size_bytes // max(each, 1)), LEAST_TURNS)


def _size(space: Any) -> int:
    """Bytes of an array in a space; 0 where it is no array, or of parts."""
    shape, dtype = getattr(space, "shape", None), getattr(space, "dtype", None)
    return int(np.prod(shape)) * dtype.itemsize if shape and dtype is not None else 0


def legal(space: Discrete, mask: Any) -> Sequence[int]:
    """The actions that a mask allows, of a space of any size; none where the mask doesn't fit."""
    numbers = range(int(space.start), int(space.start) + int(space.n))
    if mask is None:
        return numbers
    flags = np.asarray(mask).ravel()
    return [numbers[at] for at in np.flatnonzero(flags)] if len(flags) == len(numbers) else []
