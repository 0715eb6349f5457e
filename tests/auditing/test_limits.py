"""Limits of time that nobody has declared: where they are named, and how they end an episode."""

from typing import Any, Final

import numpy as np
import pytest

from gamekeeper.auditing.audit import audit_here
from gamekeeper.auditing.gather import session_of
from gamekeeper.auditing.probe_session import ProbeSession, TimeUpError
from gamekeeper.auditing.probes.surface import far_limits, limits_of
from gamekeeper.interface.opening import open_env
from tests.auditing.roster_games import Counting
from tests.auditing.test_rosters import audited, broken
from tests.faults.rovers import Rovers

TICK_LIMIT: Final = 6
"""The name that the classes below find in their module; no instance holds the number."""


class Terminating(Counting):
    """All end by termination when time is up."""

    def __init__(self) -> None:
        super().__init__(ends=(TICK_LIMIT, TICK_LIMIT, TICK_LIMIT))


class Truncating(Counting):
    """All are cut when time is up."""

    def __init__(self) -> None:
        super().__init__(ends=(900, 900, 900), limit=TICK_LIMIT)


class Emptied(Counting):
    """Batteries of many sizes; some are empty in the very tick in which time is up."""

    def __init__(self) -> None:
        super().__init__(limit=TICK_LIMIT)

    def reset(self, seed: int | None = None, options: Any = None) -> Any:
        """The last agent ends in one of four ticks, of which the limit is one."""
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        last = int(self.rng.integers(TICK_LIMIT - 3, TICK_LIMIT + 1))
        self.ends = dict.fromkeys(self.possible_agents, last)
        return super().reset(seed, options)


class Staying(Counting):
    """All are cut late, and stay in the roster."""

    def __init__(self, max_steps: int = 900) -> None:
        super().__init__(ends=(9_000, 9_000, 9_000), limit=max_steps)
        self.max_steps = max_steps

    def step(self, actions: dict[Any, Any]) -> Any:
        """Puts back those that were cut."""
        out = super().step(actions)
        self.agents = self.possible_agents[:]
        return out


class Settled:
    """Holds numbers in many places."""

    max_cycles = 11

    def __init__(self, deadline: int = 12, size_limit: int = 13) -> None:
        self.n_steps, self.end, self.size = 14, deadline, size_limit
        self.settings: dict[str, Any] = {"horizon": 15, "max_players": 16, "cutoff": 17.0}
        self.max_laps, self.bid_limit = 18, 19


def test_limits_of_the_module_that_terminate_are_found() -> None:
    """A limit's name may stand outside the instance."""
    assert {"GK508"} == broken(Terminating)


def test_limits_of_the_module_that_truncate_break_nothing() -> None:
    """Where the other flag is up all is well."""
    assert set() == broken(Truncating)


def test_rule_that_sometimes_ends_in_the_last_tick_is_no_limit() -> None:
    """Where most episodes end before it, what meets the limit is chance."""
    found = audited(Emptied).of("GK508")
    assert found.outcome in ("passed", "not_exercised")


def test_limits_are_found_wherever_they_are_named() -> None:
    """In the instance, its settings, its class, its constructor and its module."""
    found = limits_of(Settled())

    assert {name: found[name] for name in found if found[name] < 100} == {
        "max_cycles": 11,
        "deadline": 12,
        "n_steps": 14,
        "horizon": 15,
        "TICK_LIMIT": 6,
    }


def test_the_end_of_the_time_is_no_fault_of_the_environment() -> None:
    """Time that ends within a probe's call ends the probe, and isn't what the call raised."""

    def out_of_time() -> None:
        raise TimeUpError

    with pytest.raises(TimeUpError):
        ProbeSession.call(None, "look", out_of_time)  # type: ignore[arg-type]  # reads no self


def test_time_that_ends_within_an_episode_is_no_step_that_raised() -> None:
    """It cuts the first episode of a look; what it cuts later is no rerun to compare with that."""
    session = session_of(open_env(Rovers), None, spec=Rovers, kwargs={}, seed=0, budget=100)
    left = 4

    def late() -> None:
        nonlocal left
        left -= 1
        session.meter.until_s = None if left > 0 else 0.0

    session.meter.beat = late
    cut = session.play(next(session.plays(1)))
    assert (cut.failed, len(cut.play.actions or ())) == (None, 2)
    left = 3
    with pytest.raises(TimeUpError):
        session.play(cut.play)


class Bounded:
    """Constructors with numbers that are called like limits, or nearly."""

    def __init__(
        self,
        max_steps: int = 5000,
        max_turns: int | None = None,
        max_cycles: int = 9,
        max_turn_angle: int = 90,
        max_agents: int = 100,
        horizon: float = 1e6,
    ) -> None: ...


def test_far_limits_are_arguments_of_time_and_of_turns() -> None:
    """Arguments that hold a large whole number or None, not what is near already, nor no limit."""
    assert far_limits(Bounded(), {}, 11) == ["max_steps", "max_turns"]
    assert far_limits(Bounded(), {"max_steps": 5, "max_cycles": 40}, 11) == [
        "max_turns",
        "max_cycles",
    ]


LATE: Final = 125
"""Ticks that no rollout of a small budget has; twice as many, and a few, are on top of it."""


class StayingLate(Staying):
    """Its limit is no argument of its constructor, and longer than a rollout."""

    def __init__(self) -> None:
        super().__init__(max_steps=LATE)


class TerminatingLate(Counting):
    """All end by termination when time is up, after more ticks than a rollout has."""

    def __init__(self) -> None:
        super().__init__(ends=(LATE, LATE, LATE), limit=9_000)
        self.max_steps = LATE


class TruncatingLate(Counting):
    """All are cut when time is up, after more ticks than a rollout has."""

    def __init__(self) -> None:
        super().__init__(ends=(9_000, 9_000, 9_000), limit=LATE)
        self.max_steps = LATE


@pytest.mark.parametrize(
    ("game", "expected"),
    [(StayingLate, {"GK503"}), (TerminatingLate, {"GK508"}), (TruncatingLate, set())],
)
def test_limit_of_an_instance_is_met_as_it_is(game: Any, expected: set[str]) -> None:
    """Without a nearer one, by as many ticks."""
    select = "GK503", "GK508", "GK52", "GK60", "GK61"
    found = audit_here(game, select=select, budget=2_200)
    assert expected == {each.id for each in found.failed}
    for each in found.failed:  # by an instance as it is
        assert "probe near_limit" in each.findings[0].where
        assert "return build()" in each.findings[0].reproducer
        assert f"for _ in range({LATE})]" in each.findings[0].reproducer
