"""A clean environment with long episodes: no check is broken on it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._long_rovers import LongRovers

BREAKS: tuple[str, ...] = ()


def make(**kwargs: Any) -> LongRovers:
    """The environment as it should be."""
    return LongRovers(**kwargs)
