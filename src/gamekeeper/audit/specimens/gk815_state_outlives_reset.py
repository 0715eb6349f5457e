"""The state is kept until the next step, also over a reset."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK815",)
ALSO = ("GK604",)
"""What outlives a reset also parts a second episode from a first one."""


class StateOutlivesReset(Rovers):
    """A clean environment otherwise."""

    kept: Any = None

    def step(self, actions: dict[str, Any]) -> Any:
        """The state is another now."""
        self.kept = None
        return super().step(actions)

    def state(self) -> Any:
        """Made once a turn."""
        if self.kept is None:
            self.kept = super().state()
        return self.kept.copy()


def make(**kwargs: Any) -> StateOutlivesReset:
    """The environment with its one fault."""
    return StateOutlivesReset(**kwargs)
