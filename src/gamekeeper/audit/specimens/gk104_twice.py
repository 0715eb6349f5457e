"""A rover stands twice in `agents` once another one has ended."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK104",)


class Twice(Rovers):
    """The place of the dead is filled with a name that is there."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Fills up the roster."""
        out = super().step(actions)
        if self.agents and len(self.agents) < self.count:
            self.agents = [*dict.fromkeys(self.agents), self.agents[0]]
        return out


def make(**kwargs: Any) -> Twice:
    """The environment with its one fault."""
    return Twice(**kwargs)
