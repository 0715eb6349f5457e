"""`rewards` isn't cleared: what a round paid is paid again with every bid of the next."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK405",)


class RewardsStand(Traders):
    """Only None steps clear the rewards."""

    def _clear_rewards(self) -> None:
        """Forgets to."""

    def _was_dead_step(self, action: Any) -> None:
        """Clears them."""
        super()._was_dead_step(action)
        super()._clear_rewards()


def make(**kwargs: Any) -> RewardsStand:
    """The environment with its one fault."""
    return RewardsStand(**kwargs)
