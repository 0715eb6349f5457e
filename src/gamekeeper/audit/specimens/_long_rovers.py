"""Rovers whose batteries last, so that an episode is long."""

from __future__ import annotations

from gamekeeper.audit.specimens._rovers import Rovers


class LongRovers(Rovers):
    """Two hundred ticks for everybody."""

    def __init__(self, count: int = 2, horizon: int = 200, render_mode: str | None = None) -> None:
        super().__init__(count, horizon, render_mode)

    def drive(self, agent: str, action: int) -> None:
        """A move that costs nothing."""
        super().drive(agent, action)
        self.battery[agent] += 1
