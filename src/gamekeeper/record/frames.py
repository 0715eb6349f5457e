"""Rendered frames as files."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from gamekeeper.core.canon import to_json
from gamekeeper.errors import DependencyError


def encode_frame(frame: Any) -> tuple[str, bytes]:
    """A frame as suffix and bytes of a file: PNG, text, or canonical JSON of what is neither.

    Args:
        frame: [height, width, 3 or 4] uint8, or a text.
    Raises:
        DependencyError: Pillow isn't installed.
    """
    if isinstance(frame, str):
        return "txt", frame.encode(errors="replace")
    if not _is_picture(frame):
        return "json", to_json(frame).encode(errors="replace")
    image = require_pillow().fromarray(np.ascontiguousarray(frame))
    buffer = io.BytesIO()
    image.save(buffer, "PNG", compress_level=1)
    return "png", buffer.getvalue()


def _is_picture(frame: Any) -> bool:
    return (
        isinstance(frame, np.ndarray)
        and frame.dtype == np.uint8
        and frame.ndim == 3
        and frame.shape[2] in (3, 4)
        and frame.size > 0
    )


def require_pillow() -> Any:
    """`PIL.Image`, which writes frames that are pictures.

    Raises:
        DependencyError: Pillow isn't installed.
    """
    try:
        from PIL import Image
    except ImportError as error:
        raise DependencyError(
            "frames are written with Pillow, which isn't installed",
            mend="pip install 'gamekeeper[frames]', or record without frames",
        ) from error
    return Image
