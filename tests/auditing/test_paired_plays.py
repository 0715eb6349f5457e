"""Programs that compare plays."""

import re
from typing import Any

import numpy as np

from gamekeeper.checks.paired_episodes import TWICE, program, told_difference
from gamekeeper.episodes.divergence import Divergence
from tests.faults.rovers import Rovers

KEPT: list[Any] = []


class Cargo:
    """An object without a repr of its own."""


class Carrying(Rovers):
    """Puts a new object into every info."""

    def info(self, agent: str) -> Any:
        """Infos with an object, which is kept so that its address isn't used again."""
        KEPT.append(Cargo())
        return {**super().info(agent), "cargo": KEPT[-1]}


def test_addresses_of_objects_are_no_difference() -> None:
    """Two equal plays are alike although the objects in their infos lie elsewhere."""
    found = program("parallel", *TWICE)
    assert "re" in found.imports
    scope = {"make": Carrying, "SEED": 1, "ACTIONS": [], "np": np, "re": re}
    exec(found.lines, scope)


def test_difference_of_dictionaries_is_told_where_it_lies() -> None:
    """Both values are those of the first key that differs, however long the dictionaries are."""
    one, two = ({"events": {f"event_{k}": k // 9 == late for k in range(40)}} for late in (1, 2))
    told = told_difference(Divergence(0, 3, "a", "info", one, two))
    assert told == "info['a']['events']['event_9'] at turn 3 is false, not true"


def test_difference_of_lists_is_told_where_it_lies() -> None:
    """Of rows the first that differs, and tuples stand as lists."""
    one, two = [(2, 6), (3, 5)], [(2, 6), (4, 5)]
    told = told_difference(Divergence(0, 0, "a", "obs.resources", one, two))
    assert told == "obs.resources['a'][1][0] at turn 0 is 4, not 3"
    told = told_difference(Divergence(0, 0, "a", "obs.resources", one, two[:1]))
    assert told == "obs.resources['a'] at turn 0 is [[2,6]], not [[2,6],[3,5]]"
