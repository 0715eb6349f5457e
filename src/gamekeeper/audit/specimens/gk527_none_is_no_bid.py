"""The None of a trader that has ended is read as a bid, which raises."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._traders import Traders

BREAKS = ("GK527",)


class NoneIsNoBid(Traders):
    """Every action is a number here."""

    def _was_dead_step(self, action: Any) -> None:
        """Notes the bid of one that is out."""
        super()._was_dead_step(int(action))


def make(**kwargs: Any) -> NoneIsNoBid:
    """The environment with its one fault."""
    return NoneIsNoBid(**kwargs)
