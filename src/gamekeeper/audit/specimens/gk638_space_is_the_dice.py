"""The wind is drawn by sampling from the space of actions that is handed out."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK638",)


class SpaceIsTheDice(Rovers):
    """The spaces' generators are the game's dice."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Seeds the spaces too."""
        for place, agent in enumerate(self.possible_agents):
            self._done[agent].seed(None if seed is None else seed + place)
        return super().reset(seed, options)

    def drive(self, agent: str, action: int) -> None:
        """Now and then somewhere else than was wished."""
        drift = int(self._done[agent].sample())
        super().drive(agent, drift if drift == 1 else action)


def make(**kwargs: Any) -> SpaceIsTheDice:
    """The environment with its one fault."""
    return SpaceIsTheDice(**kwargs)
