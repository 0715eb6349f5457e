"""A trader's money is what it was at the end of the episode before."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK604",)


class KeptPurse(Traders):
    """Winnings outlast a reset."""

    def reset(self, seed: int | None = None, options: Any = None) -> None:
        """Who has money keeps it."""
        kept = getattr(self, "money", {})
        super().reset(seed, options)
        self.money.update({a: purse for a, purse in kept.items() if purse > 0})


def make(**kwargs: Any) -> KeptPurse:
    """The environment with its one fault."""
    return KeptPurse(**kwargs)
