"""A rover that waited is given no observation."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK107",)


class WaitingUnseen(Rovers):
    """Only who moved is shown something."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Leaves out who waited and goes on."""
        out = super().step(actions)
        for agent in self.agents:
            if int(actions[agent]) == 0:
                del out[0][agent]
        return out


def make(**kwargs: Any) -> WaitingUnseen:
    """The environment with its one fault."""
    return WaitingUnseen(**kwargs)
