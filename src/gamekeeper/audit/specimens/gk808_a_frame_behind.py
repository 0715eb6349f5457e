"""render() hands out the frame that was drawn at the call before."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK808",)


class AFrameBehind(Rovers):
    """Two buffers, swapped too late."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Both buffers are empty."""
        self.back: Any = None
        return super().reset(seed, options)

    def render(self) -> Any:
        """What was drawn before."""
        frame = super().render()
        shown, self.back = self.back, frame
        return frame if shown is None else shown


def make(**kwargs: Any) -> AFrameBehind:
    """The environment with its one fault."""
    return AFrameBehind(**kwargs)
