"""`_cumulative_rewards` isn't cleared: `last()` gives the return so far."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK404",)


class NeverCleared(Traders):
    """What a trader was told is told again."""

    def step(self, action: Any) -> None:
        """Puts back what has been told."""
        agent = self.agent_selection
        told = self._cumulative_rewards[agent]
        super().step(action)
        if agent in self._cumulative_rewards:
            self._cumulative_rewards[agent] += told


def make(**kwargs: Any) -> NeverCleared:
    """The environment with its one fault."""
    return NeverCleared(**kwargs)
