"""A mode is declared that the constructor refuses."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK801",)


class RefusesAnsi(Rovers):
    """Declares text, and has pictures only."""

    metadata = {**Rovers.metadata, "render_modes": ["rgb_array", "ansi"]}  # noqa: RUF012

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(render_mode=render_mode)
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"there is no mode {render_mode!r}")


def make(**kwargs: Any) -> RefusesAnsi:
    """The environment with its one fault."""
    return RefusesAnsi(**kwargs)
