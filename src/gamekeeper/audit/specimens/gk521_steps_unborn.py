"""A step before any reset plays, from a state that nobody has seeded."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK521",)


class StepsUnborn(Rovers):
    """Resets itself at its first step."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Begins an episode where none was."""
        if self.rng is None:
            self.reset()
        return super().step(actions)


def make(**kwargs: Any) -> StepsUnborn:
    """The environment with its one fault."""
    return StepsUnborn(**kwargs)
