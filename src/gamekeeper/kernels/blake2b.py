"""BLAKE2b over many short messages, compiled: the digests that `hashlib` gives one by one.

Eight messages go side by side, so that the processor's wide registers hold a word of each.

Source: RFC 7693.
"""

from functools import cache
from hashlib import blake2b
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gamekeeper.kernels.compile_cache import compiled, key_of
from gamekeeper.kernels.scalar_rules import OPTIONS, numba

LANES: Final = 8
FEW: Final = 64
"""So few messages aren't worth loading compiled code for."""
FIRST: Final = np.array(
    [
        0x6A09E667F3BCC908,
        0xBB67AE8584CAA73B,
        0x3C6EF372FE94F82B,
        0xA54FF53A5F1D36F1,
        0x510E527FADE682D1,
        0x9B05688C2B3E6C1F,
        0x1F83D9ABFB41BD6B,
        0x5BE0CD19137E2179,
    ],
    np.uint64,
)
"""The initialization vector, RFC 7693 section 2.6."""
ORDER: Final = np.array(
    [
        [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15],
        [14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3],
        [11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4],
        [7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8],
        [9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13],
        [2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9],
        [12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11],
        [13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10],
        [6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5],
        [10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0],
        [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15],
        [14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3],
    ]
)
"""Words of the message that each of the 12 rounds takes, RFC 7693 section 2.7."""


def digests(data: NDArray[np.uint8], bounds: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
    """The BLAKE2b digests of parts of `data`, [parts, size].

    Args:
        data: the messages, one after the other.
        bounds: [parts + 1] where each begins, and the last ends.
        size: bytes of a digest; a multiple of 8.
    """
    count = len(bounds) - 1
    if count <= FEW or numba() is None:
        raw, ends = data.tobytes(), bounds.tolist()
        found = [blake2b(raw[ends[k] : ends[k + 1]], digest_size=size) for k in range(count)]
        joined = b"".join([each.digest() for each in found])
        return np.frombuffer(joined, np.uint8).reshape(count, size)
    words = np.empty((count, size // 8), np.uint64)
    _compiled_hash()(np.ascontiguousarray(data), np.ascontiguousarray(bounds, np.int64), words)
    return words.view(np.uint8)


def row_digests(table: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Digest of each row of bytes, [rows, size]; `gamekeeper.episodes.digest` hashes with it."""
    rows, width = table.shape
    return digests(table.reshape(-1), np.arange(rows + 1, dtype=np.int64) * width, size)


@cache
def _compiled_hash() -> Any:
    all_of = _all_of()
    return compiled(all_of, "blake2b", key_of(all_of))


def _rounds() -> Any:
    """`rounds(w, message)`, compiled: the twelve rounds over all lanes."""
    mix = numba().njit(_mix, forceinline=True, **OPTIONS)

    def rounds(w: Any, message: Any) -> None:
        for r in range(12):
            for j in range(16):
                word = ORDER[r, j]
                for lane in range(LANES):
                    w[(16 + j) * LANES + lane] = message[word * LANES + lane]
            mix(w, 0, 4, 8, 12, 0)
            mix(w, 1, 5, 9, 13, 2)
            mix(w, 2, 6, 10, 14, 4)
            mix(w, 3, 7, 11, 15, 6)
            mix(w, 0, 5, 10, 15, 8)
            mix(w, 1, 6, 11, 12, 10)
            mix(w, 2, 7, 8, 13, 12)
            mix(w, 3, 4, 9, 14, 14)

    return numba().njit(rounds, forceinline=True, **OPTIONS)


def _all_of() -> Any:
    """Function that fills `out`, [parts, words], with the digests."""
    rounds = _rounds()
    word_at = numba().njit(_word_at, forceinline=True, **OPTIONS)

    def all_of(data: Any, bounds: Any, out: Any) -> None:
        w = np.empty(32 * LANES, np.uint64)
        message = np.zeros(16 * LANES, np.uint64)
        h = np.empty(8 * LANES, np.uint64)
        lanes, words = LANES, out.shape[1]
        head = np.uint64(0x01010000 + words * 8)  # no key, one leaf, size of the digest (2.5)
        for first in range(0, len(out), lanes):
            rows = min(lanes, len(out) - first)
            blocks = 1
            for lane in range(rows):
                size = bounds[first + lane + 1] - bounds[first + lane]
                blocks = max(blocks, (size + 127) // 128)
            for k in range(8):
                for lane in range(lanes):
                    h[k * lanes + lane] = FIRST[k] ^ head if k == 0 else FIRST[k]
            for b in range(blocks):
                for k in range(8):
                    for lane in range(lanes):
                        w[k * lanes + lane] = h[k * lanes + lane]
                        w[(8 + k) * lanes + lane] = FIRST[k]
                for lane in range(rows):
                    start, end = bounds[first + lane], bounds[first + lane + 1]
                    at = start + b * 128
                    for k in range(16):
                        message[k * lanes + lane] = word_at(data, at + k * 8, end)
                    # RFC 7693, 3.2: word 12 takes the bytes so far, word 14 is turned round in the
                    # last block.
                    w[12 * lanes + lane] ^= np.uint64(min(at + 128, end) - start)
                    if at + 128 >= end:
                        w[14 * lanes + lane] = ~w[14 * lanes + lane]
                rounds(w, message)
                for lane in range(rows):
                    start, end = bounds[first + lane], bounds[first + lane + 1]
                    if b == 0 or start + b * 128 < end:  # shorter messages are done
                        for k in range(8):
                            at = k * lanes + lane
                            h[at] ^= w[at] ^ w[8 * lanes + at]
            for lane in range(rows):
                for k in range(words):
                    out[first + lane, k] = h[k * lanes + lane]

    return all_of


def _word_at(data: Any, at: Any, end: Any) -> Any:
    """The eight bytes from `at` on, those from `end` on being zeros."""
    word = np.uint64(0)
    if at + 8 <= end:
        for k in range(8):
            word |= np.uint64(data[at + k]) << np.uint64(8 * k)
    else:
        for k in range(end - at):
            word |= np.uint64(data[at + k]) << np.uint64(8 * k)
    return word


def _mix(w: Any, a: Any, b: Any, c: Any, d: Any, x: Any) -> None:
    """The function G of RFC 7693 section 3.1, in all lanes."""
    for lane in range(LANES):
        va, vb = w[a * LANES + lane], w[b * LANES + lane]
        vc, vd = w[c * LANES + lane], w[d * LANES + lane]
        va = va + vb + w[(16 + x) * LANES + lane]
        vd ^= va
        vd = (vd >> np.uint64(32)) | (vd << np.uint64(32))
        vc += vd
        vb ^= vc
        vb = (vb >> np.uint64(24)) | (vb << np.uint64(40))
        va = va + vb + w[(17 + x) * LANES + lane]
        vd ^= va
        vd = (vd >> np.uint64(16)) | (vd << np.uint64(48))
        vc += vd
        vb ^= vc
        vb = (vb >> np.uint64(63)) | (vb << np.uint64(1))
        w[a * LANES + lane], w[b * LANES + lane] = va, vb
        w[c * LANES + lane], w[d * LANES + lane] = vc, vd
