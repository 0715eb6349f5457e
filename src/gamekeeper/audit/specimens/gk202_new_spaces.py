"""Every call makes a new action space."""

from __future__ import annotations

from typing import Any

from gymnasium import spaces

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK202",)


class NewSpaces(Rovers):
    """Seeding an action space has no effect."""

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """A new one."""
        return spaces.Discrete(5)


def make(**kwargs: Any) -> NewSpaces:
    """The environment with its one fault."""
    return NewSpaces(**kwargs)
