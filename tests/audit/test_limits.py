"""Limits of time that nobody has declared: where they are named, and how they end an episode."""

from typing import Any, Final

from gamekeeper.audit.probes._limits import limits_of
from tests.audit.roster_games import Counting
from tests.audit.test_rosters import broken

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


class Settled:
    """Holds numbers in many places."""

    max_cycles = 11

    def __init__(self, deadline: int = 12, size_limit: int = 13) -> None:
        self.n_steps, self.end, self.size = 14, deadline, size_limit
        self.settings: dict[str, Any] = {"horizon": 15, "max_players": 16, "cutoff": 17.0}


def test_limits_of_the_module_that_terminate_are_found() -> None:
    """A limit's name may stand outside the instance."""
    assert {"GK508"} == broken(Terminating)


def test_limits_of_the_module_that_truncate_break_nothing() -> None:
    """Where the other flag is up all is well."""
    assert set() == broken(Truncating)


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
