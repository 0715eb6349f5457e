"""possible_agents is empty until the first reset."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK101",)


class NamedLate(Rovers):
    """Who may play is known once somebody does."""

    def __init__(self, **kwargs: Any) -> None:
        """Spaces are there, names are not."""
        super().__init__(**kwargs)
        self.possible_agents = []

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Names the rovers."""
        self.possible_agents = [f"rover_{i}" for i in range(self.count)]
        return super().reset(seed, options)


def make(**kwargs: Any) -> NamedLate:
    """The environment with its one fault."""
    return NamedLate(**kwargs)
