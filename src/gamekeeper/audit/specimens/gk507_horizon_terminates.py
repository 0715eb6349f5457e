"""The declared horizon terminates the rovers that are left; it should truncate them."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK507",)
CONTRACT = {"schedule": {"horizon": 20}}


class HorizonTerminates(Rovers):
    """A time limit is told as a rule of the game."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Tells every end as a termination."""
        out = super().step(actions)
        ended = {a: out[2][a] or out[3][a] for a in out[2]}
        return *out[:2], ended, dict.fromkeys(ended, False), out[4]


def make(**kwargs: Any) -> HorizonTerminates:
    """The environment with its one fault."""
    return HorizonTerminates(**kwargs)
