"""Who has ended can't be observed: `last()` raises at its None turn."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK527",)


class DeadUnseen(Traders):
    """A purse that is empty is thrown away."""

    def observe(self, agent: str) -> Any:
        """Opens the purse."""
        if self.terminations.get(agent):
            raise KeyError(agent)
        return super().observe(agent)


def make(**kwargs: Any) -> DeadUnseen:
    """The environment with its one fault."""
    return DeadUnseen(**kwargs)
