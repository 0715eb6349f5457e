"""When one rover ends the roster is emptied, and the others' flags stay down."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK502",)


class OneEndsAll(Rovers):
    """The first empty battery is the end for all."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Sends everybody away with the first who ends."""
        out = super().step(actions)
        if any(out[2].values()):
            self.agents = []
        return out


def make(**kwargs: Any) -> OneEndsAll:
    """The environment with its one fault."""
    return OneEndsAll(**kwargs)
