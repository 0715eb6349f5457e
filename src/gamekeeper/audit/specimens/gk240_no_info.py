"""The info of a rover that just ended is None."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK240",)


class NoInfo(Rovers):
    """Nothing is said at the end."""

    def info(self, agent: str) -> Any:
        """None without a battery."""
        return super().info(agent) if self.battery[agent] > 0 else None


def make(**kwargs: Any) -> NoInfo:
    """The environment with its one fault."""
    return NoInfo(**kwargs)
