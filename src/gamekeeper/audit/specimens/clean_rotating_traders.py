"""A clean environment that declares its rotating order: no check is broken on it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS: tuple[str, ...] = ()
CONTRACT = {"schedule": {"stages": [["trader"]], "order": "rotating"}}


class RotatingTraders(Traders):
    """The opening trader rotates, as declared."""


def make(**kwargs: Any) -> RotatingTraders:
    """The environment as it should be."""
    return RotatingTraders(**kwargs)
