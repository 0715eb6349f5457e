"""render() draws its colours from the generator of the wind."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK805",)


class DrawnShade(Rovers):
    """Nicer pictures."""

    def render(self) -> Any:
        """With some noise."""
        frame = super().render()
        if frame is not None:
            frame[0, 0] = self.rng.integers(256)
        return frame


def make(**kwargs: Any) -> DrawnShade:
    """The environment with its one fault."""
    return DrawnShade(**kwargs)
