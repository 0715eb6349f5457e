"""GK111."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK111",
    needs=("surface",),
    severity=LOW,
    mend="leave num_agents and max_num_agents to PettingZoo's base class, which counts the lists",
)
def num_agents_counts_the_roster(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """num_agents is the length of `agents`, and max_num_agents that of possible_agents.

    Loops and buffers are sized by them; a number that was fixed at construction is wrong from the
    first death on.

    Bad: `num_agents = 3`, while two are left.

    Good: no attributes of one's own, but those of `ParallelEnv` and `AECEnv`.
    """
    for fact in evidence.facts("surface", "counts"):
        for turn, (live, most, agents, possible) in enumerate(fact.value):
            for name, roster, said, size in (
                ("num_agents", "agents", live, agents),
                ("max_num_agents", "possible_agents", most, possible),
            ):
                if said is not None and size is not None:
                    yield Occasion(
                        replace(fact.where, turn=turn, field=name), said == size, size, said,
                        proof=f"count = len(env.{roster})\n"
                        f"assert env.{name} == count, (env.{name}, count)",
                    )  # fmt: skip
