"""The contract declares the mask in the infos, and it stands in the observation."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._tokens import Tokens

BREAKS = ("GK236",)


CONTRACT = {"roles": {"player": {"agents": "player_*", "mask": "infos.action_mask"}}}


class MaskElsewhere(Tokens):
    """Declared at the wrong place; any free cell is then taken for any other."""

    def step(self, action: Any) -> None:
        """Takes the next free cell, as policies see no mask."""
        legal = self.legal()
        if action is not None and legal.any():
            action = next(int(c % len(legal)) for c in range(action, 99) if legal[c % len(legal)])
        super().step(action)


def make(**kwargs: Any) -> MaskElsewhere:
    """The environment with its one fault."""
    return MaskElsewhere(**kwargs)
