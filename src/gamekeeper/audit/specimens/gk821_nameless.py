"""The metadata has no name."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK821",)


class Nameless(Rovers):
    """A clean environment otherwise."""

    metadata = {k: v for k, v in Rovers.metadata.items() if k != "name"}  # noqa: RUF012


def make(**kwargs: Any) -> Nameless:
    """The environment with its one fault."""
    return Nameless(**kwargs)
