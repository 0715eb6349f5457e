"""The state is the one before the tick."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK817",)


class StateATickLate(Rovers):
    """A clean environment otherwise."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Keeps the state."""
        out = super().reset(seed, options)
        self.kept = super().state()
        return out

    def step(self, actions: dict[str, Any]) -> Any:
        """Keeps the state, and goes on."""
        self.kept = super().state()
        return super().step(actions)

    def state(self) -> Any:
        """As it was before the tick."""
        return self.kept.copy()


def make(**kwargs: Any) -> StateATickLate:
    """The environment with its one fault."""
    return StateATickLate(**kwargs)
