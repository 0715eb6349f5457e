"""A rover that ends has no entry in rewards in that step."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK108",)


class LastRewardLost(Rovers):
    """Only who goes on is paid."""

    def step(self, actions: dict[str, Any]) -> Any:
        """Pays the living."""
        out = super().step(actions)
        return out[0], {a: out[1][a] for a in self.agents}, *out[2:]


def make(**kwargs: Any) -> LastRewardLost:
    """The environment with its one fault."""
    return LastRewardLost(**kwargs)
