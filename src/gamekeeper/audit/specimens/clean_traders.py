"""A clean environment: no check is broken on it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS: tuple[str, ...] = ()


def make(**kwargs: Any) -> Traders:
    """The environment as it should be."""
    return Traders(**kwargs)
