"""The dead are given observations and infos until the episode is over."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK113",)


class Ghosts(Rovers):
    """Everybody is shown everything."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Adds those who have left."""
        out = super().step(actions)
        for agent in self.possible_agents if out[0] else ():
            out[0].setdefault(agent, self.observation(agent))
            out[4].setdefault(agent, self.info(agent))
        return out


def make(**kwargs: Any) -> Ghosts:
    """The environment with its one fault."""
    return Ghosts(**kwargs)
