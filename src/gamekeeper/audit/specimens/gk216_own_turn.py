"""A trader observes nothing while it is another one's turn."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK216",)


class OwnTurn(Traders):
    """Closed eyes between the own turns."""

    def observe(self, agent: str) -> Any:
        """None for all but one."""
        return super().observe(agent) if agent == self.agent_selection else None


def make(**kwargs: Any) -> OwnTurn:
    """The environment with its one fault."""
    return OwnTurn(**kwargs)
