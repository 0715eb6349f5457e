"""The dead stand in rewards, terminations and truncations until the episode is over."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK106",)


class AllAccounts(Rovers):
    """Accounts are kept of everybody."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Adds those who have left."""
        out = super().step(actions)
        for agent in self.possible_agents if out[1] else ():
            out[1].setdefault(agent, 0.0)
            out[2].setdefault(agent, True)
            out[3].setdefault(agent, False)
        return out


def make(**kwargs: Any) -> AllAccounts:
    """The environment with its one fault."""
    return AllAccounts(**kwargs)
