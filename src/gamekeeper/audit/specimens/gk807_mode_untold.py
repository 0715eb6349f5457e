"""The mode that was asked for is kept under another name."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK807",)


class ModeUntold(Rovers):
    """Renders, and doesn't say how."""

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=None)
        self.mode = render_mode

    def render(self) -> Any:
        """As the mode says."""
        self.render_mode, told = self.mode, self.render_mode
        frame = super().render()
        self.render_mode = told
        return frame


def make(**kwargs: Any) -> ModeUntold:
    """The environment with its one fault."""
    return ModeUntold(**kwargs)
