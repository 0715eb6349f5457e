"""Rewards of a round in which a trader goes bankrupt never reach `last()`."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK403",)


class LastRewardLost(Traders):
    """The step that ends somebody returns too early."""

    def _accumulate_rewards(self) -> None:
        """Forgets to, where somebody has ended."""
        if not any(self.terminations.values()):
            super()._accumulate_rewards()


def make(**kwargs: Any) -> LastRewardLost:
    """The environment with its one fault."""
    return LastRewardLost(**kwargs)
