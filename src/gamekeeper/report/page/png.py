"""Pictures as PNG without any graphics library."""

from __future__ import annotations

import struct
import zlib
from base64 import b64encode
from typing import Final

import numpy as np
from numpy.typing import NDArray

SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
COLOURS: Final = {1: 0, 3: 2, 4: 6}
"""PNG's number for grey, rgb and rgb with alpha, by channels. Source: PNG (2nd ed.), 11.2.2."""


def png(pixels: NDArray[np.uint8]) -> bytes:
    """A picture of [height, width, 1, 3 or 4] as the bytes of a PNG file."""
    height, width, channels = pixels.shape
    head = struct.pack(">IIBBBBB", width, height, 8, COLOURS[channels], 0, 0, 0)
    lines = np.zeros((height, width * channels + 1), np.uint8)  # a filter type before each line
    lines[:, 1:] = pixels.reshape(height, width * channels)
    body = zlib.compress(lines.tobytes(), 9)
    return SIGNATURE + _chunk(b"IHDR", head) + _chunk(b"IDAT", body) + _chunk(b"IEND", b"")


def data_url(picture: bytes) -> str:
    """A PNG file as an address that holds it whole."""
    return "data:image/png;base64," + b64encode(picture).decode("ascii")


def is_picture(pixels: NDArray[np.generic]) -> bool:
    """Whether an array has the form of a picture: 8-bit, at least 8 by 8, grey or coloured."""
    return (
        pixels.dtype == np.uint8
        and pixels.ndim == 3
        and pixels.shape[2] in COLOURS
        and min(pixels.shape[:2]) >= 8
    )


def _chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
