"""Draws and clocks that an episode hardly shows, and ends that nobody is told of."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from gamekeeper.auditing.audit import audit_here
from tests.faults.tokens import Tokens
from tests.faults.traders import Traders


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
    assert [id] == [verdict.id for verdict in audit.failed]


@pytest.mark.parametrize("id", ["GK634", "GK601", "GK110", "GK501"])
def test_audit_keeps_silent_where_nothing_is_hidden(id: str) -> None:
    """The same games without the fault keep the promise, with something to look at."""
    audit = audit_here(Traders, select=(id,), budget=900)
    assert [verdict.outcome for verdict in audit.verdicts] == ["passed"]


class FewOpenings(Tokens):
    """Resets without a seed draw one of three openings from the system."""

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Begins as PettingZoo's environments do: a new generator at each reset."""
        super().reset(seed=np.random.SeedSequence().entropy % 3 if seed is None else seed)


@pytest.mark.parametrize("seed", range(6))
def test_resets_that_draw_from_the_system_blame_no_call(seed: int) -> None:
    """Two of few openings agree by chance; that isn't taken for a reset that goes on."""
    audit = audit_here(FewOpenings, budget=2_000, seed=seed, select=("GK63",))
    assert audit.failed == ()
