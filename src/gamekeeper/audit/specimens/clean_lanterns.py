"""A clean environment: no check is broken on it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._lanterns import Lanterns

BREAKS: tuple[str, ...] = ()


def make(**kwargs: Any) -> Lanterns:
    """The environment as it should be."""
    return Lanterns(**kwargs)
