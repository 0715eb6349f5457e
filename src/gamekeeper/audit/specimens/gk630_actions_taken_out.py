"""step takes the actions out of the caller's dictionary."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK630",)


class ActionsTakenOut(Rovers):
    """The caller's dictionary is emptied."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Pops each action."""
        return super().step({agent: actions.pop(agent) for agent in list(actions)})


def make(**kwargs: Any) -> ActionsTakenOut:
    """The environment with its one fault."""
    return ActionsTakenOut(**kwargs)
