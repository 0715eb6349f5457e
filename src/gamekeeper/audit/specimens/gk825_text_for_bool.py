"""It says in words that it can't be made parallel."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK825",)


class TextForBool(Rovers):
    """A clean environment otherwise."""

    metadata = {**Rovers.metadata, "is_parallelizable": "no"}  # noqa: RUF012


def make(**kwargs: Any) -> TextForBool:
    """The environment with its one fault."""
    return TextForBool(**kwargs)
