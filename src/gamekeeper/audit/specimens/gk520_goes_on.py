"""A step after the end silently goes on."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK520",)


class GoesOn(Rovers):
    """Once all rovers have ended they rove on."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Goes on with all rovers where none is left."""
        if self.agents or not actions:
            return super().step(actions)
        rovers = list(actions)
        observations = {a: self.observation(a) for a in rovers}
        flags = dict.fromkeys(rovers, False)
        infos: dict[str, Any] = {a: {} for a in rovers}
        return observations, {a: self.reward(a) for a in rovers}, flags, dict(flags), infos


def make(**kwargs: Any) -> GoesOn:
    """The environment with its one fault."""
    return GoesOn(**kwargs)
