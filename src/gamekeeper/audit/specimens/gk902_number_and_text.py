"""One player is called 1, the other "1"."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK902",)
ALSO = ("GK104", "GK402", "GK503", "GK608")
"""In evidence, which knows agents by their text, the two are one: it lives on when either ends."""


class NumberAndText(Rovers):
    """Two rovers whose names look alike."""

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__(count=2, render_mode=render_mode)
        names: list[Any] = [1, "1"]
        self._seen = dict(zip(names, self._seen.values(), strict=True))
        self._done = dict(zip(names, self._done.values(), strict=True))
        self.possible_agents = names


def make(**kwargs: Any) -> NumberAndText:
    """The environment with its one fault."""
    return NumberAndText(**kwargs)
