"""A dead trader's bid is accepted."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK522",)


class DeadMayBid(Traders):
    """Whatever a dead trader does is taken for None."""

    def _was_dead_step(self, action: Any) -> None:
        """Doesn't look at the action."""
        super()._was_dead_step(None)


def make(**kwargs: Any) -> DeadMayBid:
    """The environment with its one fault."""
    return DeadMayBid(**kwargs)
