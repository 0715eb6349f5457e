"""A rover that has ended comes back under its name three ticks later."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK112",)


class Revived(Rovers):
    """A new battery brings it back."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Revives who has been out for long."""
        out = super().step(actions)
        if not self.agents:
            return out
        for agent in self.possible_agents:
            if agent not in out[2]:
                self.out[agent] = self.out.get(agent, 0) + 1
                if self.out[agent] == 3:
                    self.agents.append(agent)
                    self.battery[agent] = 9
                    new = self.observation(agent), 0.0, False, False, self.info(agent)
                    for part, value in zip(out, new, strict=True):
                        part[agent] = value
        return out

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Nobody has been out."""
        self.out: dict[str, int] = {}
        return super().reset(seed, options)


def make(**kwargs: Any) -> Revived:
    """The environment with its one fault."""
    return Revived(**kwargs)
