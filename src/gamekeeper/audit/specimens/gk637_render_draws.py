"""render() draws from the game's generator, whatever the mode."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK637",)
ALSO = ("GK805",)
"""It draws in a mode as it does without one."""


class RenderDraws(Rovers):
    """Each picture draws."""

    def render(self) -> Any:
        """Dust in the picture."""
        self.rng.random()
        return super().render()


def make(**kwargs: Any) -> RenderDraws:
    """The environment with its one fault."""
    return RenderDraws(**kwargs)
