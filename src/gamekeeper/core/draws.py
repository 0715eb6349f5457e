"""Many numbers of a Stream at once, as arrays, to the last bit those that it draws one by one.

Nothing here is compiled: of floating point only the operations are used whose result IEEE 754 fixes
(see `philox`), one after the other as there, and an array's elements come out as single numbers do.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.core import philox
from gamekeeper.core.stream import Stream

Floats = NDArray[np.float64]
Words = NDArray[np.uint64]

_WORD: Final = np.uint64(philox.WORD)
_HALF: Final = np.uint64(32)


def words(stream: Stream, count: int) -> Words:
    """[count] the words that the stream would give next; it stays where it is.

    Args:
        count: at least 1.
    """
    first, skipped = stream.draws >> 2, stream.draws & 3
    blocks = np.arange((skipped + count + 3) // 4, dtype=np.uint64) + np.uint64(first)
    counter = [blocks & _WORD, blocks >> _HALF]
    counter += [np.full_like(blocks, number) for number in (stream.episode, stream.lane)]
    drawn = _philox(counter, stream.seed & philox.WORD, stream.seed >> 32)
    return drawn.reshape(-1)[skipped : skipped + count]


def units(stream: Stream, count: int) -> Floats:
    """[count] what `uniform()` would give next, in [0, 1)."""
    pairs = words(stream, 2 * count).reshape(-1, 2)
    whole = (pairs[:, 0] >> np.uint64(5)) * np.uint64(67108864) + (pairs[:, 1] >> np.uint64(6))
    return whole.astype(np.float64) * philox.STEP


def normals(stream: Stream, count: int) -> Floats:
    """[count] what `normal()` would give next."""
    pairs = words(stream, 2 * count).reshape(-1, 2)
    shifted = pairs[:, 0] * np.uint64(1048576) + (pairs[:, 1] >> np.uint64(12))
    return _normals((shifted * np.uint64(2) + np.uint64(1)).astype(np.float64))


def _philox(counter: list[Words], k0: int, k1: int) -> Words:
    """[blocks, 4] the images of many counters under one key."""
    c0, c1, c2, c3 = counter
    for _ in range(10):
        p0 = c0 * np.uint64(philox.M0)
        p1 = c2 * np.uint64(philox.M1)
        c0, c1, c2, c3 = (
            (p1 >> _HALF) ^ c1 ^ np.uint64(k0),
            p1 & _WORD,
            (p0 >> _HALF) ^ c3 ^ np.uint64(k1),
            p0 & _WORD,
        )
        k0 = (k0 + philox.W0) & philox.WORD
        k1 = (k1 + philox.W1) & philox.WORD
    return np.stack((c0, c1, c2, c3), axis=-1)


def _normals(odd: Floats) -> Floats:
    """The quantiles of odd numbers out of 2**53, branch by branch of `philox.normal_of`."""
    q = odd * philox.STEP - 0.5
    found = np.empty_like(q)
    is_middle = np.abs(q) <= 0.425
    middle = q[is_middle]
    found[is_middle] = middle * _ratio(0.180625 - middle * middle, philox._MID_TOP, philox._MID_LOW)
    odd, q = odd[~is_middle], q[~is_middle]
    r = np.sqrt(-_log(np.minimum(odd, philox.STEPS - odd) * philox.STEP))
    x = _ratio(r - 1.6, philox._TAIL_TOP, philox._TAIL_LOW)
    if (r > 5.0).any():  # one number in 10**11
        x = np.where(r <= 5.0, x, _ratio(r - 5.0, philox._FAR_TOP, philox._FAR_LOW))
    found[~is_middle] = np.where(q < 0.0, -x, x)
    return found


def _log(x: Floats) -> Floats:
    """As `philox.log_of`."""
    m, exponent = np.frexp(x)
    is_low = m < philox._SQRT_HALF
    m, exponent = np.where(is_low, m * 2.0, m), exponent - is_low
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    total = np.zeros_like(s)
    for term in philox._ATANH:
        total *= z
        total += term
    return exponent * philox._LN2 + 2.0 * s * total


def _ratio(r: Floats, top: philox._Poly, low: philox._Poly) -> Floats:
    above, below = np.zeros_like(r), np.zeros_like(r)
    for one, other in zip(top, low, strict=True):
        above *= r
        above += one
        below *= r
        below += other
    return above / below
