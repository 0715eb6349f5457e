"""A reset leaves out the rovers whose batteries ran empty in the last episode."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK103",)
ALSO = ("GK604",)
"""The next episode isn't that of a fresh instance: somebody is missing in it."""


class NotRestored(Rovers):
    """The dead are dead for the next episode too."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Takes those who were left, and all of them where nobody was."""
        left = getattr(self, "left", [])
        out = super().reset(seed, options)
        self.agents = left or self.agents
        self.left: list[str] = []
        return tuple({a: part[a] for a in self.agents} for part in out)

    def step(self, actions: dict[str, Any]) -> Any:
        """Notes who was there when the first rover ended."""
        out = super().step(actions)
        self.left = self.left or (list(self.agents) if any(out[2].values()) else [])
        return out


def make(**kwargs: Any) -> NotRestored:
    """The environment with its one fault."""
    return NotRestored(**kwargs)
