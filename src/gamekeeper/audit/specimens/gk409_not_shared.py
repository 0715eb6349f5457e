"""A term that is declared as shared is paid to those alone who found something."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS = ("GK409",)
CONTRACT = {
    "rewards": {
        "sample": {"kind": "individual", "payee": "earner"},
        "team": {"kind": "shared", "payee": "all"},
    }
}


class NotShared(Rovers):
    """The team's share goes to the finder."""

    def __init__(self, **kwargs: Any) -> None:
        """Tells what it pays by term."""
        super().__init__(**kwargs)
        self.terms: dict[str, dict[str, float]] = {}

    def step(self, actions: dict[str, Any]) -> Any:
        """Pays the team's share to finders."""
        out = super().step(actions)
        found = out[1]
        team = 0.5 * sum(found.values())
        self.terms = {a: {"sample": found[a], "team": team if found[a] else 0.0} for a in found}
        for agent in found:
            found[agent] = sum(self.terms[agent].values())
        return out


def make(**kwargs: Any) -> NotShared:
    """The environment with its one fault."""
    return NotShared(**kwargs)
