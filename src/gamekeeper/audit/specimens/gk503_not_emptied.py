"""`agents` isn't emptied when the horizon has truncated everybody."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK503",)


class NotEmptied(Rovers):
    """The last ones stay in the roster."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Keeps those whom the horizon ended."""
        out = super().step(actions)
        if any(out[3].values()):
            self.agents = [a for a in out[3] if out[3][a]]
        return out


def make(**kwargs: Any) -> NotEmptied:
    """The environment with its one fault."""
    return NotEmptied(**kwargs)
