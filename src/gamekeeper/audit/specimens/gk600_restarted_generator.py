"""Every reset begins the generator anew from a constant: all episodes are one."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK600",)


class RestartedGenerator(Traders):
    """Lots and winners are drawn, and always the same ones."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Knows the seed that was good once."""
        super().reset(7, options)


def make(**kwargs: Any) -> RestartedGenerator:
    """The environment with its one fault."""
    return RestartedGenerator(**kwargs)
