"""A clean environment with its masks declared: no check is broken on it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._tokens import Tokens

BREAKS: tuple[str, ...] = ()
CONTRACT = {
    "roles": {
        "player": {
            "agents": "player_*",
            "mask": "observation.action_mask",
            "illegal": "error",
        }
    }
}


def make(**kwargs: Any) -> Tokens:
    """The environment as it should be."""
    return Tokens(**kwargs)
