"""GK104."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK104",
    needs=("rollout", "surface"),
    severity=HIGH,
    mend="keep each name once; take agents out of the list that is there, or build it anew in "
    "reset, before names are added",
)
def every_agent_is_named_once(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """No name stands twice in `agents` or in `possible_agents`.

    Two agents of one name are one in every dictionary: an action, a reward, a policy is lost, and
    who is removed once is still there.

    Bad: `self.agents += self.possible_agents` in a reset that doesn't empty the list first.

    Good: `self.agents = self.possible_agents[:]`.
    """
    for fact in evidence.facts("rollout", "agents"):
        for turn, names in enumerate(fact.value):
            yield Occasion(
                replace(fact.where, turn=turn), len(set(names)) == len(names),
                "each name once", names, proof=_proof("agents"),
            )  # fmt: skip
    for fact in evidence.facts("surface", "possible_agents"):
        for turn, names in enumerate(fact.value["turns"]):
            if names is not None:
                yield Occasion(
                    replace(fact.where, turn=turn), len(set(names)) == len(names),
                    "each name once", names, proof=_proof("possible_agents"),
                )  # fmt: skip


def _proof(roster: str) -> str:
    return f"names = list(env.{roster})\nassert len(names) == len(set(names)), names"
