"""Draws and clocks that an episode hardly shows, and ends that nobody is told of."""

from __future__ import annotations

import time
from typing import Any, ClassVar

import numpy as np
import pytest

from gamekeeper.auditing.audit import audit_here
from tests.auditing.lucky_games import Sound
from tests.faults.tokens import Tokens
from tests.faults.traders import Traders


class DrawsForResetsOnly(Tokens):
    """Observing draws, and nothing but a reset reads what is drawn then."""

    def observe(self, agent: str) -> dict[str, Any]:
        """Draws beside looking."""
        self.rng.random()
        return super().observe(agent)


class LooksOpenAndShut(Tokens):
    """Observing turns a lid, so that two looks leave it as it was."""

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Begins with the lid open."""
        self.is_open = True
        super().reset(seed, options)

    def observe(self, agent: str) -> dict[str, Any]:
        """Turns the lid of who isn't in turn."""
        self.is_open ^= agent != self.agent_selection
        return super().observe(agent)

    def step(self, action: Any) -> None:
        """Takes the first free cell under a lid that is shut."""
        if action is not None and not self.is_open:
            action = int(np.flatnonzero(self.legal())[0])
        super().step(action)


class DrawsTogetherLate(Sound):
    """Short episodes, and from its sixth tick on an episode that isn't draws from the class."""

    dice: ClassVar = np.random.default_rng(0)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """Seeds the generator of all instances."""
        out = super().reset(seed, options)
        DrawsTogetherLate.dice = np.random.default_rng(seed)
        self.end = 9 if 0.4 < self.rng.random() < 0.7 else 4
        return out

    def step(self, actions: Any) -> Any:
        """Ends before the twentieth tick."""
        out = super().step(actions)
        if self.tick > 5:
            out[0].update(dict.fromkeys(out[0], np.full(2, self.dice.random())))
        is_over = self.tick >= self.end
        self.agents = [] if is_over else self.agents
        return (*out[:3], dict.fromkeys(out[0], is_over), out[4])


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
    [
        (DrawsForResetsOnly, "GK634", 300),
        (LooksOpenAndShut, "GK634", 300),
        (DrawsTogetherLate, "GK607", 600),
        (ByTheClock, "GK601", 600),
        (LastOfFour, "GK110", 200),
    ],
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
