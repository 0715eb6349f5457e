"""GK202."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK202",
    needs=("spaces",),
    severity=MEDIUM,
    mend="make each space once and return that object: from a dictionary, or with functools.cache",
)
def spaces_are_one_object(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An agent's space is the very same object at every call, not a new one.

    A seed that is given to a space which is thrown away has no effect: sampled actions differ in
    every run, and each call costs what making a space costs. PettingZoo's own API test asks for it.

    Bad:

        def action_space(self, agent): return Discrete(5)

    Good:

        @functools.cache
        def action_space(self, agent): return Discrete(5)
    """
    for fact in evidence.facts("spaces", "space"):
        if fact.value["space"] is None:
            continue
        name = fact.where.field
        yield Occasion(
            fact.where, bool(fact.value["is_same"]), "the same object twice", "two objects",
            proof=f"for agent in env.agents:\n    assert env.{name}(agent) is env.{name}(agent)",
        )  # fmt: skip
