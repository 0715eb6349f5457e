"""A time limit that nobody has declared is told as a termination."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK508",)


class LimitTerminates(Rovers):
    """Whoever is left at the horizon terminates."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Tells every end as a termination."""
        out = super().step(actions)
        ended = {a: out[2][a] or out[3][a] for a in out[2]}
        return *out[:2], ended, dict.fromkeys(ended, False), out[4]


def make(**kwargs: Any) -> LimitTerminates:
    """The environment with its one fault."""
    return LimitTerminates(**kwargs)
