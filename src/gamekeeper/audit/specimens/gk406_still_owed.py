"""A reset leaves what was owed: the next episode begins with rewards of the last one."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK406",)
ALSO = ("GK604",)
"""What is owed outlives the reset, so the second episode isn't a fresh one's."""


class StillOwed(Traders):
    """The books of the last episode are carried over."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Keeps what hadn't been told."""
        owed = dict(getattr(self, "_cumulative_rewards", {}))
        super().reset(seed, options)
        self._cumulative_rewards.update(owed)


def make(**kwargs: Any) -> StillOwed:
    """The environment with its one fault."""
    return StillOwed(**kwargs)
