"""Spaces in a few words, for a card and for an error."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from gymnasium import spaces

LIMIT: Final = 240
"""Characters of a space in a cell of a card; a nested one takes several lines."""
FEW: Final = 6
"""As many numbers of a MultiDiscrete are written out."""
DEEPEST: Final = 8
"""Levels of nested spaces that are written out."""


def space_text(space: spaces.Space[Any] | None, *, limit: int = LIMIT) -> str:
    """The space on one line of at most `limit` characters, `?` where it isn't known."""
    return "?" if space is None else cut(_text(space, DEEPEST), limit)


def cut(text: str, limit: int) -> str:
    """The text, or its beginning with an ellipsis where it is longer than `limit`."""
    return text if len(text) <= limit else text[: max(limit - 1, 0)] + "…"


def _text(space: spaces.Space[Any], depth: int) -> str:
    name = type(space).__name__
    if depth == 0:
        return "…"
    match space:
        case spaces.Discrete():
            start = int(space.start)
            return f"Discrete({space.n})" if start == 0 else f"Discrete({space.n}, from {start})"
        case spaces.Box():
            return f"Box({_bounds(space)}, {_shape(space)}, {space.dtype})"
        case spaces.MultiDiscrete():
            counts = np.asarray(space.nvec).reshape(-1)
            listed = " ".join(str(count) for count in counts[:FEW])
            return f"MultiDiscrete({listed}{' …' if counts.size > FEW else ''})"
        case spaces.MultiBinary():
            return f"MultiBinary({_shape(space)})"
        case spaces.Text():
            return f"Text({space.min_length} to {space.max_length} characters)"
        case spaces.Dict():
            rows = (f"{key}: {_text(inner, depth - 1)}" for key, inner in space.items())
            return "{" + ", ".join(rows) + "}"
        case spaces.Tuple():
            return "(" + ", ".join(_text(inner, depth - 1) for inner in space.spaces) + ")"
        case spaces.OneOf():
            return "one of " + " | ".join(_text(inner, depth - 1) for inner in space.spaces)
        case spaces.Sequence():
            return f"Sequence({_text(space.feature_space, depth - 1)})"
        case _:
            return " ".join(repr(space).split()) if name in vars(spaces) else name


def _shape(space: spaces.Space[Any]) -> str:
    return str(list(space.shape or ()))


def _bounds(space: spaces.Box) -> str:
    """Equal bounds once; a range over all elements where they differ."""
    if space.low.size == 0:
        return "empty"
    low, high = space.low.min(), space.high.max()
    same = (space.low == low).all() and (space.high == high).all()
    return f"{low:g} to {high:g}" if same else f"within {low:g} to {high:g}"
