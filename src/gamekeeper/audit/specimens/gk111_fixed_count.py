"""num_agents doesn't notice that rovers end."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK111",)


class FixedCount(Rovers):
    """As many as there were."""

    @property
    def num_agents(self) -> int:
        """What the constructor was told."""
        return self.count


def make(**kwargs: Any) -> FixedCount:
    """The environment with its one fault."""
    return FixedCount(**kwargs)
