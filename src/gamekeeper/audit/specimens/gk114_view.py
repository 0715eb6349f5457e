"""`agents` is a view of the keys of a dictionary."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK114",)


class View(Rovers):
    """The roster is whoever has a place in a dictionary."""

    def step(self, actions: dict[str, Any]) -> Any:
        """A step over a list, a view in its place."""
        self.agents = list(self.agents)
        out = super().step(actions)
        self.agents = dict.fromkeys(self.agents).keys()  # type: ignore[assignment]
        return out

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Likewise."""
        out = super().reset(seed, options)
        self.agents = dict.fromkeys(self.agents).keys()  # type: ignore[assignment]
        return out


def make(**kwargs: Any) -> View:
    """The environment with its one fault."""
    return View(**kwargs)
