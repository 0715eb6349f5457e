"""A forbidden move is declared an error, and is quietly taken."""

from __future__ import annotations

from typing import Any

import numpy as np

from gamekeeper.audit.specimens._tokens import Tokens

BREAKS = ("GK237",)


CONTRACT = {
    "roles": {
        "player": {
            "agents": "player_*",
            "mask": "observation.action_mask",
            "illegal": "error",
        }
    }
}


class QuietlyTaken(Tokens):
    """Whoever plays a taken cell gets the first free one."""

    def step(self, action: Any) -> None:
        """Mends what is forbidden."""
        legal = self.legal()
        if action is not None and 0 <= action < len(legal) and not legal[action]:
            action = int(np.argmax(legal))
        super().step(action)


def make(**kwargs: Any) -> QuietlyTaken:
    """The environment with its one fault."""
    return QuietlyTaken(**kwargs)
