"""Segments: Arrow IPC streams that hold every appended batch even when the process is killed.

A segment is an ordinary Arrow IPC stream (any Arrow library reads it): one schema message, record
batches compressed with zstd, and at its regular end the end-of-stream mark. Each batch message
carries in its metadata a CRC-32 over the messages so far, so that a cut (bytes missing at the end,
what a kill or a full disk leaves) can be told from damage (bytes that are there and wrong).

Nothing waits in the process, so no kill of it loses a batch. Segments are not synced: a power cut
may take what the system had not written yet (Linux writes it after 30 s at the latest). What it
leaves is told from damage as well: a file that is shorter, or holds zeros from some sector on.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

END: Final = b"\xff\xff\xff\xff\x00\x00\x00\x00"
CRC: Final = b"gamekeeper.crc32="
NO_CRC: Final = b"00000000"
SEGMENT: Final = re.compile(r"(episodes|steps|states|timings)-(\d{4,9})\.arrows")


@dataclass(frozen=True, slots=True)
class Cut:
    """Where a file's whole content ends before the file or the stream does, and why."""

    file: str
    offset: int
    why: str
