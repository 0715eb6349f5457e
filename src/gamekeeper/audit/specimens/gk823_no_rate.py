"""Pictures are rendered at no rate."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK823",)


class NoRate(Rovers):
    """A clean environment otherwise."""

    metadata = {k: v for k, v in Rovers.metadata.items() if k != "render_fps"}  # noqa: RUF012


def make(**kwargs: Any) -> NoRate:
    """The environment with its one fault."""
    return NoRate(**kwargs)
