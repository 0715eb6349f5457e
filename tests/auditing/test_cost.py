"""Cost and memory: what counts as growth, and what doesn't."""

import sys
import tracemalloc
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.probes.cost import traced_memory, work_of
from gamekeeper.checks.metadata.growing_cost import is_rising, means
from tests.faults.rovers import LongRovers


class Bounded(LongRovers):
    """Looks back on ten ticks, never more."""

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.past: list[Any] = []
        return super().reset(seed, options)

    def step(self, actions: dict[str, Any]) -> Any:
        self.past = [*self.past[-9:], dict(actions)]
        for past in self.past:
            sum(past.values())
        return super().step(actions)


class Counts(LongRovers):
    """Keeps one number for each episode."""

    def __init__(self) -> None:
        super().__init__()
        self.returns: list[float] = []

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.returns.append(1.5 * len(self.returns))
        return super().reset(seed, options)


class Uneven(LongRovers):
    """Leaves now little and now more, and on the whole no more than a line of a log."""

    def __init__(self) -> None:
        super().__init__()
        self.notes: list[bytes] = []
        self.resets = 0

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        self.resets += 1
        self.notes.append(bytes((330, 1_000, 400)[self.resets % 3]))
        return super().reset(seed, options)


@pytest.mark.parametrize("kind", [Bounded, Counts, Uneven])
def test_cost_that_is_bounded_is_no_growth(kind: type[LongRovers]) -> None:
    """A window of the past and a line of a log are no leak."""
    assert audit_here(kind, select=("GK83",), budget=300).failed == ()


def test_cost_is_the_same_on_every_run() -> None:
    """Lines are counted, so two audits say the same."""
    spec = "tests.faults.cost:HistoryInLines"
    one, two = (audit_here(spec, select=("GK83",), budget=300) for _ in range(2))
    seen = [
        [finding.actual for v in audit.failed for finding in v.findings] for audit in (one, two)
    ]
    assert seen[0] == seen[1] != []


def test_cost_of_work_is_counted_in_lines_and_bytes() -> None:
    """Three lines are three lines, and a list takes its bytes."""

    def work() -> int:
        held = [0] * 10_000
        assert held
        return len(held)

    with traced_memory():
        value, cost = work_of(work)
    assert (value, cost.lines) == (10_000, 3)
    assert 80_000 <= cost.passing_bytes < 90_000


def test_cost_leaves_debuggers_and_tracers_alone() -> None:
    """Whoever episodes goes on doing so."""
    before = sys.gettrace(), tracemalloc.is_tracing()
    with pytest.raises(ZeroDivisionError), traced_memory():
        work_of(lambda: 1 // 0)
    assert (sys.gettrace(), tracemalloc.is_tracing()) == before


@given(st.floats(1, 1e6), st.integers(8, 60))
def test_cost_that_stays_never_rises(level: float, turns: int) -> None:
    """A constant series is flat."""
    assert not is_rising(means([level] * turns), factor=2.0, least=0.0)


@given(st.integers(16, 200), st.floats(1.0, 50.0))
def test_cost_in_proportion_to_the_turn_rises(turns: int, slope: float) -> None:
    """A series that grows with the turn is found."""
    assert is_rising(means([slope * turn for turn in range(turns)]), factor=2.0, least=0.0)
