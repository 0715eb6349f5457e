"""Every instance adds a render mode to the list of the class."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK824",)


class GrowingModes(Rovers):
    """Adds a mode for text."""

    metadata = {**Rovers.metadata, "render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        self.metadata["render_modes"].append("ansi")  # type: ignore[attr-defined]

    def render(self) -> Any:
        """A picture, or the cells in words."""
        return str(self.cells) if self.render_mode == "ansi" else super().render()


def make(**kwargs: Any) -> GrowingModes:
    """The environment with its one fault."""
    return GrowingModes(**kwargs)
