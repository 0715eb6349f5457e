"""A part of the reward stands under no term."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK408",)
CONTRACT = {
    "rewards": {
        "sample": {"kind": "individual", "payee": "earner"},
        "team": {"kind": "shared", "payee": "all"},
    }
}


class PaidBeside(Rovers):
    """Who shares in a find is paid a bonus that no term names."""

    def __init__(self, **kwargs: Any) -> None:
        """Tells what it pays by term."""
        super().__init__(**kwargs)
        self.terms: dict[str, dict[str, float]] = {}

    def step(self, actions: dict[str, Any]) -> Any:
        """Pays a bonus beside the terms."""
        out = super().step(actions)
        found = out[1]
        team = 0.5 * sum(found.values())
        self.terms = {a: {"sample": found[a], "team": team} for a in found}
        for agent in found:
            found[agent] += 1.5 * team
        return out


def make(**kwargs: Any) -> PaidBeside:
    """The environment with its one fault."""
    return PaidBeside(**kwargs)
