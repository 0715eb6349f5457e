"""How much memory files of a given size may ask for before they are taken for a trap.

A few hundred bytes of zstd or of a Parquet dictionary can stand for terabytes. What unpacks to too
much is refused before memory is taken for it: a batch or a row group by how much it grows, a whole
table by the memory that there is.
"""

from __future__ import annotations

import os
from typing import Final

import pyarrow as pa

GROWTH: Final = 1000
# Any batch may ask for this much: frames of a still picture shrink 2,000-fold.
BATCH_BYTES: Final = 4 << 30
MEMORY_BYTES: Final = 64 << 30  # where the system doesn't tell how much there is
OFFSET_BYTES: Final = 8  # of an element of a list or a text, at most


def check_growth(grown_bytes: int, file_bytes: int) -> None:
    """Does nothing where a batch out of so many bytes may honestly hold so much.

    Raises:
        ValueError: it may not.
    """
    limit = max(BATCH_BYTES, GROWTH * file_bytes)
    if grown_bytes > limit:
        raise ValueError(f"{file_bytes} bytes that unpack to more than {limit}")


def check_memory(table_bytes: int) -> None:
    """Does nothing where this machine has the memory for a table of so many bytes.

    Raises:
        ValueError: it hasn't.
    """
    limit = memory_bytes()
    if table_bytes > limit:
        raise ValueError(f"a table of {table_bytes} bytes, and a machine with {limit}")


def memory_bytes() -> int:
    """The machine's memory."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # no such call on Windows
        return MEMORY_BYTES


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
