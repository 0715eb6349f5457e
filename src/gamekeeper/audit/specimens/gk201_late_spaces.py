"""Spaces are made by the first reset."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK201",)


class LateSpaces(Rovers):
    """Before a reset nobody has a space."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.later, self._seen, self._done = (self._seen, self._done), {}, {}

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Only now there are spaces."""
        self._seen, self._done = self.later
        return super().reset(seed, options)


def make(**kwargs: Any) -> LateSpaces:
    """The environment with its one fault."""
    return LateSpaces(**kwargs)
