"""Traders are declared to bid in a fixed order, and rotate."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK306",)
CONTRACT = {"schedule": {"stages": [["trader"]], "order": "fixed"}}


class OtherOrder(Traders):
    """As it is, under a contract that says otherwise."""


def make(**kwargs: Any) -> OtherOrder:
    """The environment with its one fault."""
    return OtherOrder(**kwargs)
