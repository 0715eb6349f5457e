"""A clean environment with its infos declared: no check is broken on it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS: tuple[str, ...] = ()
CONTRACT = {"infos": {"battery": {"dtype": "int64", "shape": []}}}


def make(**kwargs: Any) -> Rovers:
    """The environment as it should be."""
    return Rovers(**kwargs)
