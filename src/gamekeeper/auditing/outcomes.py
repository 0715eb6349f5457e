"""Outcomes of a tick of a Parallel environment, compared by value and as numbers."""

import copy
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any, Final

import numpy as np

from gamekeeper.checks.effects import numbers_in
from gamekeeper.episodes.layout import agent_name
from gamekeeper.statistics.significance import FloatArray

PARTS: Final = ("observations", "rewards", "terminations", "truncations", "infos")
ROUNDING: Final = 1e-5
"""Numbers that differ by no more, relative to the larger one, differ by the order of a sum."""
LAST_DIGITS: Final = 1e-12
"""Rounding, as a part of the largest number: sums in another order in float64."""
MOST_NUMBERS: Final = 2_000
"""Numbers of one sample that a test compares; of more they are taken evenly."""

Key = tuple[str, str]
"""Part and agent."""


@dataclass(frozen=True, slots=True)
class Difference:
    """First difference of two outcomes, with both values; maybe in the last digits alone."""

    part: str
    agent: str
    one: Any
    two: Any
    is_rounding: bool


def entries(out: Any, volatile: Collection[str] = ()) -> dict[Key, Any]:
    """Values that a step returned, by part and agent; without volatile fields of infos."""
    found: dict[Key, Any] = {}
    parts = out if isinstance(out, tuple | list) and len(out) == len(PARTS) else ()
    for name, part in zip(PARTS, parts, strict=False):
        if isinstance(part, Mapping):
            for agent, value in part.items():
                if name == "infos" and volatile and isinstance(value, Mapping):
                    value = {key: each for key, each in value.items() if key not in volatile}
                found[name, agent_name(agent)] = value
    return found


def digests(out: Any, volatile: Collection[str] = ()) -> dict[Key, bytes]:
    """A digest of each entry; equal values have equal ones."""
    found = {}
    for key, value in entries(out, volatile).items():
        state = blake2b(digest_size=16)
        for piece in value_bytes(value):
            state.update(piece)
        found[key] = state.digest()
    return found


def first_difference(one: Any, two: Any, volatile: Collection[str] = ()) -> Difference | None:
    """The first entry in which two outcomes differ by more than rounding, else by rounding.

    Rewards first: they are what is told best.
    """
    left, right = entries(one, volatile), entries(two, volatile)
    scale = max(_magnitude([*left.values()]), _magnitude([*right.values()]))
    keys = sorted(left.keys() | right.keys(), key=lambda key: (key[0] != "rewards", key))
    small: Difference | None = None
    for key in keys:
        values = left.get(key), right.get(key)
        if key in left and key in right and [*value_bytes(values[0])] == [*value_bytes(values[1])]:
            continue
        is_rounding = key in left and key in right and _is_close(*values, scale)
        found = Difference(*key, *copy.deepcopy(values), is_rounding)
        if not is_rounding:
            return found
        small = small or found
    return small


def numbers(out: Any, volatile: Collection[str] = ()) -> dict[str, FloatArray]:
    """The outcome as vectors of numbers by place, for statistics."""
    return {
        f"{part} {agent}": numbers_in(value)
        for (part, agent), value in entries(out, volatile).items()
    }


def stacked(samples: Sequence[Mapping[str, FloatArray]]) -> FloatArray:
    """Samples as rows, [samples, features]; what one lacks is 0, and told by a feature more."""
    columns: list[FloatArray] = []
    for name in sorted({name for sample in samples for name in sample}):
        size = max(len(sample.get(name, ())) for sample in samples)
        block = np.zeros((len(samples), size + 1))
        for row, sample in zip(block, samples, strict=True):
            given = sample.get(name)
            if given is not None:
                row[: len(given)], row[size] = given, 1.0
        columns.append(block)
    if not columns:
        return np.zeros((len(samples), 0))
    whole = np.nan_to_num(np.concatenate(columns, axis=1), posinf=1e30, neginf=-1e30)
    varied = whole[:, (whole != whole[0]).any(axis=0)]
    step = max(-(-varied.shape[1] // MOST_NUMBERS), 1)
    return np.asarray(varied[:, ::step])


def value_bytes(value: Any) -> Iterator[bytes]:
    """Yields bytes that stand for a value; of objects of unknown kinds only their type."""
    if isinstance(value, Mapping):
        for key in sorted(value, key=str):
            yield str(key).encode()
            yield from value_bytes(value[key])
    elif isinstance(value, tuple | list):
        yield f"[{len(value)}".encode()
        for each in value:
            yield from value_bytes(each)
    elif isinstance(value, np.ndarray) and value.dtype != object:
        yield f"{value.dtype}{value.shape}".encode()
        yield value.tobytes()
    elif isinstance(value, bool | int | float | np.number | np.bool_):
        yield repr(float(value)).encode()
    elif value is None or isinstance(value, str | bytes):
        yield repr(value).encode()
    else:
        yield type(value).__qualname__.encode()


def _magnitude(value: Any) -> float:
    """The largest finite number in a value, without its sign."""
    found = np.abs(numbers_in(value))
    return float(found[np.isfinite(found)].max(initial=0.0))


def _is_close(one: Any, two: Any, scale: float) -> bool:
    """Tells whether numbers differ in their last digits only, for sums up to `scale`."""
    a, b = numbers_in(one), numbers_in(two)
    if a.shape != b.shape or np.array_equal(a, b, equal_nan=True):
        return False  # what differs is no number
    atol = max(ROUNDING * 1e-1, LAST_DIGITS * scale)  # a sum may nearly cancel out
    return bool(np.allclose(a, b, rtol=ROUNDING, atol=atol, equal_nan=True))
