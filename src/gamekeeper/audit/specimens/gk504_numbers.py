"""Truncations are 0 and 1."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK504",)


class Numbers(Rovers):
    """Flags are numbers."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Counts truncations."""
        out = super().step(actions)
        return *out[:3], {a: int(flag) for a, flag in out[3].items()}, out[4]


def make(**kwargs: Any) -> Numbers:
    """The environment with its one fault."""
    return Numbers(**kwargs)
