"""observe() draws its noise from the game's generator."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK634",)


class ObserveDraws(Traders):
    """Each look at the purses draws."""

    def observe(self, agent: str) -> Any:
        """The purses, not quite exactly; the same look twice shows the same, and draws twice."""
        seen = super().observe(agent)
        if agent != self.agent_selection:
            self.rng.random()
        return seen


def make(**kwargs: Any) -> ObserveDraws:
    """The environment with its one fault."""
    return ObserveDraws(**kwargs)
