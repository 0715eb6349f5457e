"""A clean environment: who drives into another pays for it, as its contract declares."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens.gk421_bumped_pays import CONTRACT as DECLARED
from gamekeeper.audit.specimens.gk421_bumped_pays import Lane

BREAKS: tuple[str, ...] = ()
CONTRACT = {
    **DECLARED,
    "roles": {"driver": {"noop": 0, "symmetric": True}},
    "schedule": {"order": "none", "conflicts": "joint rule", "horizon": 15},
}


class FairLane(Lane):
    """Who drives pays."""

    def who_pays(self, driver: str, hit: str) -> str:
        """The driver."""
        return driver


def make(**kwargs: Any) -> FairLane:
    """The environment as it should be."""
    return FairLane(**kwargs)
