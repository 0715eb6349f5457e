"""A clean environment: a simultaneous game in turns, whose hands show once all have chosen."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens.gk331_hands_shown import CONTRACT as DECLARED
from gamekeeper.audit.specimens.gk331_hands_shown import Hands

BREAKS: tuple[str, ...] = ()
CONTRACT = {
    **DECLARED,
    "roles": {"player": {"symmetric": True}},
}


class HiddenHands(Hands):
    """Hands of the tick stay hidden until it is over."""

    def visible(self, agent: str) -> int:
        """The hand of the last tick."""
        return self.shown[agent]


def make(**kwargs: Any) -> HiddenHands:
    """The environment as it should be."""
    return HiddenHands(**kwargs)
