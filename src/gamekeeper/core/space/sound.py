"""Whether a space is made as a space should be, and whether two are alike."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from gymnasium import spaces

from gamekeeper.core.canon import shown

Space = spaces.Space[Any]


def kept(space: Space) -> Space | None:
    """A copy that stays as the space is now; None where it can't be copied or compared."""
    try:
        copied = copy.deepcopy(space)
        return copied if same(copied, copy.deepcopy(copied)) else None
    except Exception:  # foreign code may do anything
        return None


def same(one: Space, other: Space) -> bool | None:
    """Whether two spaces hold the same values; None where their class can't say."""
    if one is other:
        return True
    if type(one).__eq__ is object.__eq__:
        return None
    try:
        return bool(one == other)
    except Exception:  # foreign code may do anything
        return None


def faults(space: Space, *, sample: bool, path: str = "") -> list[str]:
    """What is wrong with the space itself, in words; none where it can be used.

    Args:
        sample: also draw from a copy of it.
        path: of the space in another, as Python subscripts.
    """
    found: list[str] = []
    if isinstance(space, spaces.Dict):
        for key, part in space.spaces.items():
            found += faults(part, sample=False, path=f"{path}[{key!r}]")
    elif isinstance(space, spaces.Tuple):
        for at, part in enumerate(space.spaces):
            found += faults(part, sample=False, path=f"{path}[{at}]")
    elif isinstance(space, spaces.Box):
        found += [f"{fault}{f' in {path}' if path else ''}" for fault in _of_box(space)]
    elif isinstance(space, spaces.Discrete) and int(space.n) < 1:
        found.append(f"{path or 'it'} has {int(space.n)} values")
    elif isinstance(space, spaces.MultiDiscrete) and (space.nvec < 1).any():
        found.append(f"{path or 'it'} has a part of {int(space.nvec.min())} values")
    if sample and not path and not found:
        found += _of_sample(space)
    return found


def _of_box(space: spaces.Box) -> list[str]:
    low, high = np.asarray(space.low), np.asarray(space.high)
    if low.shape != space.shape or high.shape != space.shape:
        return [f"the bounds have the shapes {low.shape} and {high.shape}, not {space.shape}"]
    if low.dtype.kind == "f" and (np.isnan(low).any() or np.isnan(high).any()):
        return ["a bound is NaN"]
    wrong = low > high
    if wrong.any():
        return [f"low {low[wrong][0].item()!r} is above high {high[wrong][0].item()!r}"]
    return []


def _of_sample(space: Space) -> list[str]:
    try:
        own = copy.deepcopy(space)
    except Exception:  # what can't be copied isn't drawn from
        return []
    try:
        value = own.sample()
        is_in = bool(own.contains(value))
    except Exception as error:  # foreign code may do anything
        return [f"sample() raises {type(error).__name__}: {error}"]
    return [] if is_in else [f"sample() gives {shown(value)}, which is outside of it"]
