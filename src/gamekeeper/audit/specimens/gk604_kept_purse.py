"""Who has money left at the end of an episode begins the next with one more."""

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
        self.money.update({a: purse + 1 for a, purse in kept.items() if 0 < purse < 11})


def make(**kwargs: Any) -> KeptPurse:
    """The environment with its one fault."""
    return KeptPurse(**kwargs)
