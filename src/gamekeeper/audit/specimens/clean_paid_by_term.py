"""A clean environment that declares its reward terms: no check is broken on it."""

from __future__ import annotations

from typing import Any

from gamekeeper.audit.specimens._rovers import Rovers

BREAKS: tuple[str, ...] = ()
CONTRACT = {
    "rewards": {
        "sample": {"kind": "individual", "payee": "earner"},
        "team": {"kind": "shared", "payee": "all"},
    }
}


class PaidByTerm(Rovers):
    """A sample pays its finder, and half of it everybody."""

    def __init__(self, **kwargs: Any) -> None:
        """Tells what it pays by term."""
        super().__init__(**kwargs)
        self.terms: dict[str, dict[str, float]] = {}

    def step(self, actions: dict[str, Any]) -> Any:
        """Everybody shares in what is found."""
        out = super().step(actions)
        found = out[1]
        team = 0.5 * sum(found.values())
        self.terms = {a: {"sample": found[a], "team": team} for a in found}
        for agent in found:
            found[agent] += team
        return out


def make(**kwargs: Any) -> PaidByTerm:
    """The environment as it should be."""
    return PaidByTerm(**kwargs)
