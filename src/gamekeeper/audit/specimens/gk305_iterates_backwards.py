"""`agent_iter` goes through the agents in an order of its own."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK305",)


class IteratesBackwards(Traders):
    """An iterator of its own."""

    def agent_iter(self, max_iter: int = 2**63) -> Any:
        """Names the agents from the last to the first."""
        while self.agents and max_iter > 0:
            for agent in reversed(list(self.agents)):
                max_iter -= 1
                if max_iter >= 0:
                    yield agent


def make(**kwargs: Any) -> IteratesBackwards:
    """The environment with its one fault."""
    return IteratesBackwards(**kwargs)
