"""How much memory files of a given size may ask for before they are taken for a trap.

A few hundred bytes of zstd or of a Parquet dictionary can stand for terabytes. What would grow too
much is refused before memory is taken for it.
"""

from __future__ import annotations

from typing import Final

import pyarrow as pa

# Frames of a still picture have been seen to shrink 200-fold.
GROWTH: Final = 1000
SMALL_BYTES: Final = 4 << 30  # any file may ask for this much: still images shrink 2,000-fold
OFFSET_BYTES: Final = 8  # of an element of a list or a text, at most


def check_growth(grown_bytes: int, file_bytes: int) -> None:
    """Does nothing where files of this size may honestly hold so much.

    Raises:
        ValueError: they may not.
    """
    limit = max(SMALL_BYTES, GROWTH * file_bytes)
    if grown_bytes > limit:
        raise ValueError(f"{file_bytes} bytes that unpack to more than {limit}")


def row_bytes(kind: pa.DataType) -> int:
    """Bytes that a row of this type takes even where it is null."""
    t = pa.types
    if t.is_fixed_size_list(kind):
        return int(kind.list_size) * row_bytes(kind.value_type) + 1
    if t.is_struct(kind):
        return 1 + sum(row_bytes(kind.field(i).type) for i in range(kind.num_fields))
    try:
        return max(1, int(kind.bit_width) // 8) + 1
    except ValueError:  # a list, text or bytes, or null
        return OFFSET_BYTES + 1
