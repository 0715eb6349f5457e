"""GK101."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

PROOF = Proof("env = make()\nassert list(env.possible_agents), env.possible_agents", plays=False)


@check(
    "GK101",
    needs=("surface",),
    severity=MEDIUM,
    mend="fill possible_agents in the constructor with every agent that may ever appear; leave the "
    "attribute out where nobody can know them",
)
def possible_agents_are_known_before_a_reset(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """possible_agents names every possible agent before the first reset; it isn't empty.

    Wrappers, vector environments and trainers ask it for spaces and build one policy for each name
    before anything is reset. An environment that can't know its agents leaves the attribute out.

    Bad: `self.possible_agents = []` in the constructor, filled by `reset`.

    Good: `self.possible_agents = [f"rover_{i}" for i in range(count)]` in the constructor.
    """
    for fact in evidence.facts("surface", "possible_agents"):
        before = fact.value["before"]
        if before is None and all(names is None for names in fact.value["turns"]):
            continue
        yield Occasion(
            replace(fact.where, turn=0), bool(before),
            "the names of all possible agents, before any reset",
            "no such attribute until the reset" if before is None else before,
            proof=PROOF,
        )  # fmt: skip
