"""step keeps the caller's dictionary and reads it at the next step."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK631",)


class ActionsKept(Rovers):
    """A turn on the spot costs battery, by the actions that were kept."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nobody has driven."""
        self.before: dict[str, Any] = {}
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Whoever drives on in the same manner saves battery."""
        for agent in self.agents:
            self.battery[agent] += self.before.get(agent) == actions[agent]
        self.before = actions
        return super().step(actions)


def make(**kwargs: Any) -> ActionsKept:
    """The environment with its one fault."""
    return ActionsKept(**kwargs)
