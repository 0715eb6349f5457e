"""A clean environment: no check is broken on it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._tokens import Tokens

BREAKS: tuple[str, ...] = ()


def make(**kwargs: Any) -> Tokens:
    """The environment as it should be."""
    return Tokens(**kwargs)
