"""The state is that of the reset."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK816",)


class StateOfTheStart(Rovers):
    """A clean environment otherwise."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Keeps the state."""
        out = super().reset(seed, options)
        self.kept = super().state()
        return out

    def state(self) -> Any:
        """As it was."""
        return self.kept.copy()


def make(**kwargs: Any) -> StateOfTheStart:
    """The environment with its one fault."""
    return StateOfTheStart(**kwargs)
