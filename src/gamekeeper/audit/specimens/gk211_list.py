"""A rover whose battery is empty observes a list."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK211",)


class Lists(Rovers):
    """Only the last observation is one."""

    def observation(self, agent: str) -> Any:
        """A list at the end."""
        seen = super().observation(agent)
        return seen if self.battery[agent] > 0 else seen.tolist()


def make(**kwargs: Any) -> Lists:
    """The environment with its one fault."""
    return Lists(**kwargs)
