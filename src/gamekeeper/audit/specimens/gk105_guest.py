"""A rover joins that possible_agents doesn't list."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK105",)


class Guest(Rovers):
    """A guest arrives at the third tick."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Plays, and lets a guest look on."""
        acting = {a: action for a, action in actions.items() if a != "guest"}
        self.agents = [a for a in self.agents if a != "guest"]
        out = super().step(acting)
        if "guest" in actions or (self.time >= 3 and self.agents):
            first, is_over = next(iter(out[0])), not self.agents
            self.agents += [] if is_over else ["guest"]
            ending = 0.0, False, is_over
            for part, value in zip(out, (out[0][first].copy(), *ending, {}), strict=True):
                part["guest"] = value
        return out

    def render(self) -> Any:
        """The guest has no place on the field."""
        agents, self.agents = self.agents, [a for a in self.agents if a != "guest"]
        frame = super().render()
        self.agents = agents
        return frame

    def observation_space(self, agent: str) -> Any:
        """The guest sees what a rover sees."""
        return super().observation_space("rover_0" if agent == "guest" else agent)

    def action_space(self, agent: str) -> Any:
        """The guest may do what a rover may."""
        return super().action_space("rover_0" if agent == "guest" else agent)


def make(**kwargs: Any) -> Guest:
    """The environment with its one fault."""
    return Guest(**kwargs)
