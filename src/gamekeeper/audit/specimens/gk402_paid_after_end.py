"""A rover that has ended is paid once more, one tick late."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK402",)
ALSO = ("GK106",)
"""Who has left the game still stands in the dictionaries."""


class PaidAfterEnd(Rovers):
    """The consolation comes a tick after the end."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Owes nobody anything from before."""
        self.late: list[str] = []
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        """Pays those who ended in the step before."""
        late = self.late
        out = super().step(actions)
        self.late = [a for a in out[2] if out[2][a]]
        if self.agents:
            for agent in late:
                out[1][agent] = 0.5
        return out


def make(**kwargs: Any) -> PaidAfterEnd:
    """The environment with its one fault."""
    return PaidAfterEnd(**kwargs)
