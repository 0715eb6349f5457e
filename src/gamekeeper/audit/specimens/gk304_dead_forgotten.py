"""A bankrupt trader isn't selected any more, and stays in `agents` until all are done."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK304",)


class DeadForgotten(Traders):
    """Only one trader can go bankrupt, and it has to wait."""

    def settle(self) -> None:
        """Everybody but the first trader is lent money in time."""
        for agent in self.possible_agents[1:]:
            self.money[agent] = min(max(self.money[agent], 6), 12)
        super().settle()

    def _deads_step_first(self) -> Any:
        """Selects the dead once nobody else is left."""
        if any(not (self.terminations[a] or self.truncations[a]) for a in self.agents):
            return self.agent_selection
        return super()._deads_step_first()


def make(**kwargs: Any) -> DeadForgotten:
    """The environment with its one fault."""
    return DeadForgotten(rounds=40, **kwargs)
