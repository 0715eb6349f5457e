"""The loop over agents of an AEC environment: looks and None steps that raise."""

from typing import Any

import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.checks.verdict import Verdict
from tests.faults.tokens import Tokens
from tests.faults.traders import Traders


class TakesNone(Traders):
    """Reads the None of a dead agent as a bid."""

    def _was_dead_step(self, action: Any) -> None:
        super()._was_dead_step(int(action))


class LastOneOut(Traders):
    """Looks for the next agent where there is none."""

    def _was_dead_step(self, action: Any) -> None:
        if len(self.agents) == 1:
            raise IndexError("list index out of range")
        super()._was_dead_step(action)


class ShortMemory(Traders):
    """Looking fails from the fourth round on, whoever is in turn."""

    def last(self, observe: bool = True) -> Any:
        """Tells of a round that was forgotten."""
        if self.round > 3:
            raise KeyError(self.round)
        return super().last(observe)


class Refusing(Tokens):
    """A step of the living raises, which is no fault of the loop."""

    def step(self, action: Any) -> None:
        """Takes no second token."""
        if any(self.cells):
            raise ValueError("no more")
        super().step(action)


def verdict(build: Any) -> Verdict:
    """GK527 of an environment."""
    audit = audit_here(build, select=("GK527",), budget=400)
    found = audit.of("GK527")
    assert found.outcome != "error", found.reason
    return found


@pytest.mark.parametrize(
    ("build", "words"),
    [(TakesNone, "TypeError"), (LastOneOut, "IndexError"), (ShortMemory, "KeyError")],
)
def test_loop_that_raises_is_found(build: Any, words: str) -> None:
    """A dead agent's None step and a look at whoever is in turn raise nothing."""
    found = verdict(build)

    assert found.outcome == "failed"
    assert words in found.findings[0].actual


@pytest.mark.parametrize("build", [Traders, Tokens])
def test_loop_that_goes_through_is_kept(build: Any) -> None:
    """Deaths, ends for all at once and masks go through."""
    assert verdict(build).outcome == "passed"


def test_loop_isnt_blamed_for_a_step_of_the_living() -> None:
    """What raises for an action is another promise."""
    assert verdict(Refusing).outcome == "not_exercised"
