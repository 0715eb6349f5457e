"""After an action that it refused the environment cannot be reset any more."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK222",)


class Stuck(Rovers):
    """A guard against being called twice is not taken back when a step raises."""

    is_stepping = False

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Refuses in the middle of a step."""
        if self.is_stepping:
            raise RuntimeError("reset in the middle of a step")
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Notes that a step is being made."""
        self.is_stepping = True
        if not all(self._done[a].contains(actions[a]) for a in self.agents):
            raise ValueError("illegal action")
        out = super().step(actions)
        self.is_stepping = False
        return out


def make(**kwargs: Any) -> Stuck:
    """The environment with its one fault."""
    return Stuck(**kwargs)
