"""The render modes are one text."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK822",)


class ModesAsText(Rovers):
    """A clean environment otherwise."""

    metadata = {**Rovers.metadata, "render_modes": "rgb_array"}  # noqa: RUF012


def make(**kwargs: Any) -> ModesAsText:
    """The environment with its one fault."""
    return ModesAsText(**kwargs)
