"""Programs that compare plays."""

import re
from typing import Any

import numpy as np

from gamekeeper.checks.paired_episodes import TWICE, program
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
