"""Frames are floats in [0, 1]."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK802",)


class FloatFrame(Rovers):
    """A picture as matplotlib likes it."""

    def render(self) -> Any:
        """Scaled to 1."""
        frame = super().render()
        return None if frame is None else frame / 255.0


def make(**kwargs: Any) -> FloatFrame:
    """The environment with its one fault."""
    return FloatFrame(**kwargs)
