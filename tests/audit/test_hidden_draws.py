"""Draws and clocks that a play hardly shows, and ends that nobody is told of."""

from __future__ import annotations

import time
from typing import Any

import pytest

from gamekeeper.audit.audit import audit_here
from gamekeeper.audit.specimens._tokens import Tokens
from gamekeeper.audit.specimens._traders import Traders


class DrawsForResetsOnly(Tokens):
    """Observing draws, and nothing but a reset reads what is drawn then."""

    def observe(self, agent: str) -> dict[str, Any]:
        """Draws beside looking."""
        self.rng.random()
        return super().observe(agent)


class ByTheClock(Traders):
    """Every lot is that of the ten minutes."""

    def open_round(self) -> None:
        """Passes over what the seed has drawn."""
        super().open_round()
        self.lot = 1 + int(time.time()) // 600 % 4


class LastOfFour(Tokens):
    """Both flags are one."""

    def last(self, observe: bool = True) -> Any:
        """As it was when there was only `done`."""
        observation, reward, terminated, truncated, info = super().last(observe)
        return observation, reward, terminated or truncated, info


@pytest.mark.parametrize(
    ("build", "id", "budget"),
    [(DrawsForResetsOnly, "GK634", 300), (ByTheClock, "GK601", 600), (LastOfFour, "GK110", 200)],
)
def test_audit_finds_what_a_play_hardly_shows(build: Any, id: str, budget: int) -> None:
    """What differs in the next reset, at another time, or in form alone is broken all the same."""
    audit = audit_here(build, select=(id,), budget=budget)
    assert [id] == [verdict.id for verdict in audit.broken]


@pytest.mark.parametrize("id", ["GK634", "GK601", "GK110", "GK501"])
def test_audit_keeps_silent_where_nothing_is_hidden(id: str) -> None:
    """The same games without the fault keep the promise, with something to look at."""
    audit = audit_here(Traders, select=(id,), budget=900)
    assert [verdict.outcome for verdict in audit.verdicts] == ["kept"]
