"""What every trader saw is kept for good."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK833",)


class EpisodesKept(Traders):
    """A clean environment otherwise."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.seen: list[Any] = []

    def step(self, action: Any) -> None:
        """Keeps what the one in turn sees."""
        self.seen.append(self.observe(self.agent_selection))
        super().step(action)


def make(**kwargs: Any) -> EpisodesKept:
    """The environment with its one fault."""
    return EpisodesKept(**kwargs)
