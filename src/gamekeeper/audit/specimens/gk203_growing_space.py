"""The action space grows with every reset."""

from __future__ import annotations

from typing import Any

from gymnasium import spaces

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK203",)


class GrowingSpace(Rovers):
    """Each episode there is one more action, which does nothing."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.episodes = 0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """One more action."""
        self.episodes += 1
        self._done = {a: spaces.Discrete(5 + self.episodes) for a in self.possible_agents}
        return super().reset(seed, options)

    def drive(self, agent: str, action: int) -> None:
        """What is new does nothing."""
        super().drive(agent, action if action < 5 else 0)


def make(**kwargs: Any) -> GrowingSpace:
    """The environment with its one fault."""
    return GrowingSpace(**kwargs)
