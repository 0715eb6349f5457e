"""last() pays the agent's rewards out: who asks again is told 0."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK635",)
ALSO = ("GK403",)
"""Who is asked twice in a turn tells a sum of rewards that isn't the sum."""


class LastPaysOut(Traders):
    """Asking clears what was earned."""

    def last(self, observe: bool = True) -> Any:
        """Clears what it tells."""
        told = super().last(observe)
        self._cumulative_rewards[self.agent_selection] = 0.0
        return told


def make(**kwargs: Any) -> LastPaysOut:
    """The environment with its one fault."""
    return LastPaysOut(**kwargs)
