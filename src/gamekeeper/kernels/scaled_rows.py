"""Rows of numbers in units of their spread; where compiled code runs anyway, in one pass."""

import math
import sys
from collections.abc import Callable
from functools import cache, partial
from typing import Any, Final

import numpy as np

from gamekeeper.kernels.compile_cache import compiled, key_of

TOGETHER: Final = 16
"""Rows that are taken as one: of short ones the compiled loop would do the last numbers singly."""


def scaling(
    rows: Any, mean: Any, factor: Any, clip: float, out: Any, *, are_alike: bool
) -> Callable[[], None]:
    """Function that writes (rows - mean) * factor, within +-clip, into `out`, as `rows` are then.

    Args:
        rows: [row, ...].
        mean, factor: [row, ...] or more rows than that: NumPy is many times as quick over whole
            arrays as over short rows.
        out: [row, ...] of float32; compiled or not, it gets the same bits.
        are_alike: each row of them is as the first.
    """
    parts = rows, mean, factor, out
    is_plain = all(part.dtype == np.float32 and part.flags.c_contiguous for part in parts)
    if is_plain and rows.size and "numba" in sys.modules:  # kernels load it; to do so costs seconds
        used = math.gcd(len(rows), TOGETHER) if are_alike else len(rows)
        whole = [part.reshape(len(rows) // used, -1) for part in (rows, out)]
        means = [part[:used].reshape(-1) for part in (mean, factor)]
        return partial(_compiled(), *whole, *means, np.float32(clip))
    return partial(_in_passes, rows, mean[: len(rows)], factor[: len(rows)], out, clip)


def _in_passes(rows: Any, mean: Any, factor: Any, out: Any, clip: float) -> None:
    np.subtract(rows, mean, out=out, casting="same_kind")
    np.multiply(out, factor, out=out, casting="same_kind")
    out.clip(-clip, clip, out=out)


@cache
def _compiled() -> Any:
    return compiled(_in_one_pass, "normalize", key_of(_in_one_pass))


def _in_one_pass(rows: Any, out: Any, mean: Any, factor: Any, clip: Any) -> None:
    for r in range(rows.shape[0]):
        for i in range(rows.shape[1]):
            value = (rows[r, i] - mean[i]) * factor[i]
            value = -clip if value < -clip else value  # NaN stays NaN, as with NumPy
            out[r, i] = clip if value > clip else value
