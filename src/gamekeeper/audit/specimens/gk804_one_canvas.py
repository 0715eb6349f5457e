"""Every frame is the same array, drawn over."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK804",)


class OneCanvas(Rovers):
    """Saves an allocation."""

    canvas: Any = None

    def render(self) -> Any:
        """Draws over what it gave before."""
        frame = super().render()
        if frame is None or self.canvas is None:
            self.canvas = frame
            return frame
        self.canvas[...] = frame
        return self.canvas


def make(**kwargs: Any) -> OneCanvas:
    """The environment with its one fault."""
    return OneCanvas(**kwargs)
