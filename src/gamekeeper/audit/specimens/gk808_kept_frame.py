"""The first frame of an episode is drawn, and shown until its end."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK808",)
ALSO = ("GK809",)
"""What is kept doesn't move."""


class KeptFrame(Rovers):
    """Draws once."""

    frame: Any = None

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Forgets the frame."""
        self.frame = None
        return super().reset(seed, options)

    def render(self) -> Any:
        """A copy of the frame that was drawn first."""
        if self.frame is None:
            self.frame = super().render()
        return None if self.frame is None else self.frame.copy()


def make(**kwargs: Any) -> KeptFrame:
    """The environment with its one fault."""
    return KeptFrame(**kwargs)
