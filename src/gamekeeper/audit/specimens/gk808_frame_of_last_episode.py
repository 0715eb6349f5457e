"""Frames are kept by the tick, and outlive the reset."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK808",)


class FrameOfLastEpisode(Rovers):
    """Draws after steps only."""

    frame: Any = None

    def step(self, actions: dict[str, Any]) -> Any:
        """Something is to be drawn."""
        out = super().step(actions)
        self.frame = None
        return out

    def render(self) -> Any:
        """Draws where a step was made since."""
        if self.frame is None:
            self.frame = super().render()
        return None if self.frame is None else self.frame.copy()


def make(**kwargs: Any) -> FrameOfLastEpisode:
    """The environment with its one fault."""
    return FrameOfLastEpisode(**kwargs)
