"""It renders in a mode that its metadata doesn't have."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK822",)


class ModeUndeclared(Rovers):
    """A clean environment otherwise."""

    metadata = {**Rovers.metadata, "render_modes": ["human"]}  # noqa: RUF012


def make(**kwargs: Any) -> ModeUndeclared:
    """The environment with its one fault."""
    return ModeUndeclared(**{"render_mode": "rgb_array", **kwargs})
