"""A reset returns no infos."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK109",)


class NoInfosAtReset(Rovers):
    """Infos come with the first step."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Has nothing to say."""
        return super().reset(seed, options)[0], {}


def make(**kwargs: Any) -> NoInfosAtReset:
    """The environment with its one fault."""
    return NoInfosAtReset(**kwargs)
