"""`agents` is the same list as possible_agents, which loses everybody who ends until a reset."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK102",)


class OneList(Rovers):
    """What is removed from the one is gone from the other."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Names all rovers again."""
        self.possible_agents = [f"rover_{i}" for i in range(self.count)]
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Takes the ended out of the one list there is."""
        roster = self.possible_agents
        out = super().step(actions)
        for agent in [a for a in roster if a in out[2] and a not in self.agents]:
            roster.remove(agent)
        self.agents = roster
        return out

    def observation(self, agent: str) -> Any:
        """Of the rovers that there were."""
        seen, self.possible_agents = self.possible_agents, list(self.cells)
        out = super().observation(agent)
        self.possible_agents = seen
        return out

    def state(self) -> Any:
        """Of the rovers that there were."""
        seen, self.possible_agents = self.possible_agents, list(self.cells)
        out = super().state()
        self.possible_agents = seen
        return out


def make(**kwargs: Any) -> OneList:
    """The environment with its one fault."""
    return OneList(**kwargs)
