"""Masks are bool, which no sample takes."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._tokens import Tokens

BREAKS = ("GK231",)


class BoolMask(Tokens):
    """Comparisons that were never converted."""

    def observe(self, agent: str) -> dict[str, Any]:
        """The mask as bool."""
        seen = super().observe(agent)
        return {**seen, "action_mask": seen["action_mask"].astype(bool)}


def make(**kwargs: Any) -> BoolMask:
    """The environment with its one fault."""
    return BoolMask(**kwargs)
