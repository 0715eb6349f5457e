"""How far apart two values are, and where."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gamekeeper.core.canon import to_json

WHOLE_ELEMENTS = 16  # an array of no more is shown whole
SHOWN = 200  # characters of a value


def difference(one: Any, two: Any, tolerance: float | None) -> float | None:
    """The largest difference of two values; None if it is beyond `tolerance`, or no number's.

    Bit for bit equal values differ by 0.0. Only numbers have a tolerance: flags, texts and what is
    missing are equal or not, and an infinity equals itself alone.

    Args:
        tolerance: absolute, or relative to the larger of two numbers; None: nothing may differ.
    """
    if to_json(one) == to_json(two):
        return 0.0
    if tolerance is None:
        return None
    if isinstance(one, dict) and isinstance(two, dict) and one.keys() == two.keys():
        return _largest([difference(one[key], two[key], tolerance) for key in one])
    if isinstance(one, list | tuple) and type(one) is type(two) and len(one) == len(two):
        return _largest([difference(x, y, tolerance) for x, y in zip(one, two, strict=True)])
    a, b = _floats(one), _floats(two)
    if a is None or b is None or a.shape != b.shape:
        return None
    with np.errstate(invalid="ignore", over="ignore"):
        gap = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(a - b))
        within = gap <= tolerance * np.maximum(1.0, np.maximum(np.abs(a), np.abs(b)))
        within &= np.isfinite(gap)
    return float(gap.max(initial=0.0)) if bool(within.all()) else None


def shown_pair(one: Any, two: Any) -> tuple[str, str]:
    """Two values in a line each; of large arrays the first element that differs, with its place."""
    if (
        isinstance(one, np.ndarray)
        and isinstance(two, np.ndarray)
        and one.shape == two.shape
        and one.size > WHOLE_ELEMENTS
    ):
        same = (one == two) | ((one != one) & (two != two))
        places = np.argwhere(~same)
        if len(places):
            at = tuple(places[0].tolist())
            note = f" at {list(at)}, the first of {len(places)} of {one.size} elements that differ"
            return to_json(one[at].item()) + note, to_json(two[at].item())
    return _short(one), _short(two)


def _floats(value: Any) -> NDArray[np.float64] | None:
    """`value` as float64 if it is a number or an array of numbers; bools are none."""
    if isinstance(value, bool | str | bytes | list | tuple) or value is None:
        return None
    try:
        array = np.asarray(value)
        return array.astype(np.float64) if array.dtype.kind in "iuf" else None
    except (TypeError, ValueError, OverflowError):
        return None


def _largest(sizes: list[float | None]) -> float | None:
    known = [size for size in sizes if size is not None]
    return None if len(known) < len(sizes) else max(known, default=0.0)


def _short(value: Any) -> str:
    text = to_json(value)
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 3]}..."
