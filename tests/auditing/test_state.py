"""Edge cases of state() that the matrix doesn't show."""

from typing import Any

import numpy as np
from gymnasium import spaces

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.result import AuditResult
from tests.faults.rovers import Rovers
from tests.faults.tokens import Tokens
from tests.faults.traders import Traders


def audited(spec: Any) -> AuditResult:
    """A small audit of what is said of state()."""
    return audit_here(spec, select=("GK81",), budget=200)


class Undeclared(Rovers):
    """Has a state, and no space for it."""

    def __init__(self) -> None:
        super().__init__()
        del self.state_space


class NotANumber(Undeclared):
    """Divides by nothing."""

    def state(self) -> Any:
        return np.full(3, np.nan, np.float32)


class Nothing(Rovers):
    """Declares a state, and forgets to return it."""

    def state(self) -> Any:
        return None


class Stub(Undeclared):
    """Overrides state() with nothing, and declares no space for it."""

    def state(self) -> Any:
        return None


class Nested(Rovers):
    """A state of two parts."""

    def __init__(self) -> None:
        super().__init__()
        self.state_space = spaces.Dict(  # type: ignore[assignment]
            {"cells": spaces.Box(0.0, 1.0, (12,), np.float32), "time": spaces.Discrete(100)}
        )

    def state(self) -> Any:
        return {"cells": super().state(), "time": self.time}


class Ones(Rovers):
    """Zeros and ones of another dtype than the MultiBinary that is declared."""

    def __init__(self) -> None:
        super().__init__()
        self.state_space = spaces.MultiBinary(self.state_space.shape)  # type: ignore[assignment]  # no Box

    def state(self) -> Any:
        return (super().state() > 0.5).astype(np.int64)


class Property(Undeclared):
    """What others have as a method is a property, which has no value before the first reset."""

    @property
    def state(self) -> Any:  # type: ignore[override]  # which is what a reader meets
        assert self.agents, "reset it first"
        return {"time": self.time}


class SilentAtTheEnd(Traders):
    """Has no state once all have ended."""

    def state(self) -> Any:
        if not self.agents:
            raise RuntimeError("nobody is left")
        return super().state()


class MadeOfObservations(Rovers):
    """float64 observations, and a state() that puts them together."""

    def __init__(self) -> None:
        super().__init__()
        size = self.count * self._seen[self.possible_agents[0]].shape[0]
        self.state_space = spaces.Box(0.0, 1.0, (size,), np.float32)

    def observation(self, agent: str) -> Any:
        """Of another dtype than its space."""
        return super().observation(agent).astype(np.float64)

    def state(self) -> Any:
        """What all observe."""
        return np.concatenate([self.observation(agent) for agent in self.possible_agents])


def test_dtype_that_observations_hand_on_to_the_state_is_told_once() -> None:
    """A state() that is made of observations has their dtype, of which GK212 tells."""
    found = audit_here(MadeOfObservations, select=("GK212", "GK812"), budget=400)
    assert {each.id for each in found.failed} == {"GK212"}


def test_state_is_optional() -> None:
    """No state() is legal."""
    assert {"not_applicable"} == {verdict.outcome for verdict in audited(Tokens).verdicts}


def test_state_that_is_a_stub_is_no_state() -> None:
    """An overridden state() that returns None at every turn is one that isn't there."""
    assert {"not_applicable"} == {verdict.outcome for verdict in audited(Stub).verdicts}


def test_state_without_a_space_keeps_its_form() -> None:
    """Without a space shape and dtype are looked at against the first state."""
    found = audited(Undeclared)
    assert found.failed == ()
    assert [found.of(id).outcome for id in ("GK811", "GK812", "GK813")] == ["passed"] * 3


def test_state_of_nan_is_found_without_a_space() -> None:
    """NaN is no state, whatever is declared."""
    assert "GK813" in [verdict.id for verdict in audited(NotANumber).failed]


def test_state_of_zeros_and_ones_is_a_binary_one() -> None:
    """Of another dtype it is within its space, and of low severity."""
    found = audited(Ones)
    assert {each.id: each.severity for each in found.failed} == {"GK812": "low"}


def test_state_that_is_a_property_is_no_method() -> None:
    """Nothing is judged then, though the property raises before the first reset."""
    assert {"not_applicable"} == {verdict.outcome for verdict in audited(Property).verdicts}


def test_state_that_is_none_hasnt_its_shape() -> None:
    """None is not in a space."""
    assert "GK811" in [verdict.id for verdict in audited(Nothing).failed]


def test_state_may_be_nested() -> None:
    """A state of several parts is looked at as a whole."""
    found = audited(Nested)
    assert found.failed == ()
    assert found.of("GK813").outcome == "passed"


def test_state_after_the_end_isnt_judged() -> None:
    """What state() does once everybody has ended is its own affair."""
    assert audited(SilentAtTheEnd).failed == ()


def test_state_of_an_object_is_looked_at() -> None:
    """One instance is enough."""
    assert audited(Rovers()).of("GK815").outcome == "passed"
