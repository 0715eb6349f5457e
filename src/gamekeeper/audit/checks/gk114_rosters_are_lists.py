"""GK114."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

FINE: Final = ("list", "tuple", "")
ROSTERS: Final = ("agents", "possible_agents")


@check(
    "GK114",
    needs=("surface",),
    severity=MEDIUM,
    mend="keep the names in a list: `self.agents = list(...)`",
)
def rosters_are_lists(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """`agents` and possible_agents are lists: ordered, with a length, empty once nobody is left.

    Readers slice, index and copy them and ask `while env.agents`. A set has another order in every
    process, a view of a dictionary changes while it is walked over, an array has no truth.

    Bad: `self.agents = {"a", "b"}` or `self.agents = self.robots.keys()`.

    Good: `self.agents = list(self.robots)`.
    """
    for fact in evidence.facts("surface", "kinds"):
        for turn, kinds in fact.value:
            for roster, kind in zip(ROSTERS, kinds, strict=False):
                yield Occasion(
                    replace(fact.where, turn=turn, field=roster),
                    kind in FINE, "a list", f"a {kind}",
                    proof=f"assert isinstance(env.{roster}, (list, tuple)), type(env.{roster})",
                )  # fmt: skip
