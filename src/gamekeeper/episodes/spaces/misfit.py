"""Misfits of a value and its space: structure, dtype, shape, bounds, or NaN in it."""

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from gamekeeper.episodes.canonical import Opaque, from_json, shown, type_name
from gamekeeper.episodes.exception_text import said_by
from gamekeeper.episodes.spaces.slots import contains

Space = spaces.Space[Any]

STRUCTURE: Final = "structure"
DTYPE: Final = "dtype"
SHAPE: Final = "shape"
BOUNDS: Final = "bounds"
NAN: Final = "nan"
MOST_NUMBERS: Final = 100
"""Numbers of an array that are written out: more don't fit where a value is told."""


@dataclass(frozen=True, slots=True)
class Misfit:
    """One way in which a value isn't of its space.

    Attributes:
        kind: `structure`, `dtype`, `shape`, `bounds` or `nan`.
        path: of the part, as Python subscripts: `['action_mask']`.
        expected: in words.
        actual: in words.
        test: Python that holds for a value as it should be, over `value` and `space`.
        is_taken: Gymnasium's `contains` takes it all the same, and loses nothing of it.
    """

    kind: str
    path: str
    expected: str
    actual: str
    test: str
    is_taken: bool = False


def misfits(space: Space, value: object, path: str = "") -> Iterator[Misfit]:
    """Yields every way in which the value isn't of the space, part by part.

    As Gymnasium's `contains` has it, but for three that PettingZoo's own API test is stricter in:
    an array is an array and no list, it is of the very dtype, and NaN is told apart from a bound.
    """
    if isinstance(value, Opaque) and value.content is not None:
        value = from_json(value.content)
    if isinstance(space, spaces.Dict):
        yield from _of_dict(space, value, path)
    elif isinstance(space, spaces.Tuple):
        yield from _of_tuple(space, value, path)
    elif isinstance(space, spaces.Discrete):
        yield from _of_discrete(space, value, path)
    elif isinstance(space, spaces.Box | spaces.MultiDiscrete | spaces.MultiBinary):
        yield from _of_array(space, value, path)
    elif isinstance(space, spaces.Text) and not isinstance(value, str):
        yield Misfit(STRUCTURE, path, "a text", _described(value), f"isinstance(value{path}, str)")
    elif not contains(space, value):
        yield _outside(space, value, path)


def suspects(space: Space, values: Sequence[Any], kind: str) -> frozenset[int]:
    """The places of values that may be out of `bounds`, or hold `nan`.

    Args:
        values: all of the structure, dtypes and shapes of the space.
        kind: `bounds` or `nan`.
    """
    if isinstance(space, spaces.Dict):
        parts = [([v[key] for v in values], part) for key, part in space.spaces.items()]
    elif isinstance(space, spaces.Tuple):
        parts = [([v[at] for v in values], part) for at, part in enumerate(space.spaces)]
    else:
        return _suspects(space, values, kind)
    return frozenset().union(*(suspects(part, each, kind) for each, part in parts))


def _suspects(space: Space, values: Sequence[Any], kind: str) -> frozenset[int]:
    if isinstance(space, spaces.Discrete | spaces.Box | spaces.MultiDiscrete | spaces.MultiBinary):
        low, high = _bounds(space)
        if kind == NAN:
            return _where(values, np.isnan) if np.asarray(low).dtype.kind in "fc" else frozenset()
        if _takes_all(space, low, high):
            return frozenset()
        return _where(values, lambda many: (many < low) | (many > high))
    if kind == NAN:
        return frozenset()
    return frozenset(at for at, value in enumerate(values) if not contains(space, value))


_CHUNK: Final = 1 << 20  # elements that are compared at a time


def _where(values: Sequence[Any], is_bad: Callable[[Any], Any]) -> frozenset[int]:
    """The places of values any element of which is bad."""
    step = max(_CHUNK // max(int(np.size(values[0])), 1), 1) if values else 1
    found: list[int] = []
    for start in range(0, len(values), step):
        many = np.asarray(values[start : start + step])
        bad = is_bad(many).reshape(len(many), -1).any(axis=1)
        found.extend(start + int(at) for at in np.flatnonzero(bad))
    return frozenset(found)


def _bounds(space: Any) -> tuple[Any, Any]:
    if isinstance(space, spaces.Box):
        return space.low, space.high
    if isinstance(space, spaces.MultiBinary):
        return np.int8(0), np.int8(1)
    if isinstance(space, spaces.Discrete):
        return int(space.start), int(space.start) + int(space.n) - 1
    return space.start, space.start + (space.nvec - 1)


def _takes_all(space: Space, low: Any, high: Any) -> bool:
    """True if no value of the dtype can be out of bounds, as with pictures."""
    if not isinstance(space, spaces.Box):
        return False
    if space.dtype.kind in "iu":
        limits = np.iinfo(space.dtype)
        return bool((low == limits.min).all() and (high == limits.max).all())
    is_endless = np.isneginf(low).all() and np.isposinf(high).all()
    return bool(is_endless) and space.dtype.kind == "f"


def _of_dict(space: spaces.Dict, value: object, path: str) -> Iterator[Misfit]:
    keys = list(space.spaces)
    if not isinstance(value, dict) or value.keys() != space.spaces.keys():
        seen, test = _described(value), f"list(value{path}) == {keys!r}"
        if isinstance(value, dict):
            seen = f"the keys {list(value)}"
            test = f"set(value{path}) == set(space{path}.spaces)"
        yield Misfit(STRUCTURE, path, f"a dictionary with the keys {keys}", seen, test)
        return
    for key, part in space.spaces.items():
        yield from misfits(part, value[key], f"{path}[{key!r}]")


def _of_tuple(space: Any, value: object, path: str) -> Iterator[Misfit]:
    if not isinstance(value, tuple | list | np.ndarray) or len(value) != len(space.spaces):
        count = len(space.spaces)
        test = f"isinstance(value{path}, tuple) and len(value{path}) == {count}"
        yield Misfit(STRUCTURE, path, f"a tuple of {count}", _described(value), test)
        return
    for at, part in enumerate(space.spaces):
        yield from misfits(part, value[at], f"{path}[{at}]")


def _of_discrete(space: spaces.Discrete, value: object, path: str) -> Iterator[Misfit]:
    shape = np.shape(value) if isinstance(value, np.ndarray) else ()
    is_whole = isinstance(value, int | np.integer) or (
        isinstance(value, np.ndarray) and value.dtype.kind in "iu"
    )
    test = f"space{path}.contains(value{path})"
    if not is_whole:
        yield Misfit(STRUCTURE, path, "a whole number", _described(value), test)
    elif shape != ():
        yield Misfit(SHAPE, path, "one number, of shape ()", f"shape {shape}", test)
    elif not isinstance(value, int) and not np.can_cast(value.dtype, space.dtype):  # type: ignore[attr-defined]
        seen = str(value.dtype)  # type: ignore[attr-defined]  # no int, so of numpy
        yield Misfit(DTYPE, path, str(space.dtype), seen, test)
    elif not contains(space, value):
        yield _outside(space, value, path)


def _of_array(space: Any, value: object, path: str) -> Iterator[Misfit]:
    if isinstance(value, np.generic | float | int) and space.shape == ():
        value = np.asarray(value, None if isinstance(value, np.generic) else space.dtype)
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "biufc":
        test = f"isinstance(value{path}, np.ndarray) and value{path}.dtype.kind in 'biuf'"
        expected = f"an array of {space.dtype} {list(space.shape)}"
        is_taken = isinstance(value, tuple | list) and not isinstance(space, spaces.Box)
        is_taken = is_taken and contains(space, value)
        yield Misfit(STRUCTURE, path, expected, _described(value), test, is_taken)
        return
    if value.dtype != space.dtype:
        test = f"value{path}.dtype == space{path}.dtype"
        is_binary = isinstance(space, spaces.MultiBinary) and contains(space, value)
        is_taken = is_binary or np.can_cast(value.dtype, space.dtype)
        yield Misfit(DTYPE, path, str(space.dtype), str(value.dtype), test, is_taken)
    if value.shape != tuple(space.shape):
        test = f"value{path}.shape == space{path}.shape"
        yield Misfit(SHAPE, path, f"shape {tuple(space.shape)}", f"shape {value.shape}", test)
        return
    if value.dtype.kind in "fc" and np.isnan(value).any():
        test = f"not np.isnan(value{path}).any()"
        yield Misfit(NAN, path, "numbers", f"NaN at {_first(np.isnan(value))}", test)
    low, high = _bounds(space)
    bad = (value < low) | (value > high)
    if bad.any():
        yield _out_of_bounds(space, value, path, bad)


def _out_of_bounds(space: Any, value: Any, path: str, bad: Any) -> Misfit:
    low, high = (np.broadcast_to(bound, value.shape)[bad][0] for bound in _bounds(space))
    test = f"space{path}.contains(value{path})"
    if isinstance(space, spaces.Box):  # which says no to another dtype too
        test = f"not ((value{path} < space{path}.low) | (value{path} > space{path}.high)).any()"
    seen = f"{value[bad][0].item()!r} at {_first(bad)}"
    return Misfit(BOUNDS, path, f"within [{low.item()!r}, {high.item()!r}]", seen, test)


def _first(bad: Any) -> str:
    at = [int(i) for i in np.argwhere(bad)[0]]
    more = int(bad.sum()) - 1
    return f"{at}" + (f" and {more} more" if more else "")


def _outside(space: Space, value: object, path: str) -> Misfit:
    return Misfit(
        BOUNDS,
        path,
        f"a value of {shown(space)}",
        _described(value),
        f"space{path}.contains(value{path})",
    )


def _described(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} {list(value.shape)}"
    with np.printoptions(threshold=MOST_NUMBERS):
        return f"{type_name(value)}: {shown(value)}"


def kept(space: Space) -> Space | None:
    """A copy that stays as the space is now; None where it can't be copied or compared."""
    try:
        copied = copy.deepcopy(space)
        return copied if same(copied, copy.deepcopy(copied)) else None
    except Exception:  # foreign code may do anything
        return None


def same(one: Space, other: Space) -> bool | None:
    """True if two spaces hold the same values; None where their class can't tell."""
    if one is other:
        return True
    if type(one).__eq__ is object.__eq__:
        return None
    try:
        return bool(one == other)
    except Exception:  # foreign code may do anything
        return None


def faults(space: Space, *, sample: bool, path: str = "") -> list[str]:
    """Faults of the space itself, in words; empty where it can be used.

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
        return [f"sample() raises {said_by(error)}"]
    return [] if is_in else [f"sample() gives {shown(value)}, which is outside of it"]
