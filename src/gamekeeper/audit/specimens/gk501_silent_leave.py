"""A rover with an empty battery is taken out of `agents`, and neither flag says so."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK501",)
ALSO = ("GK502",)
"""Where the horizon truncates the others in the same step, the roster is emptied over it."""


class SilentLeave(Rovers):
    """Empty batteries end nobody."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Takes the terminations back."""
        out = super().step(actions)
        return out[0], out[1], dict.fromkeys(out[2], False), out[3], out[4]


def make(**kwargs: Any) -> SilentLeave:
    """The environment with its one fault."""
    return SilentLeave(**kwargs)
