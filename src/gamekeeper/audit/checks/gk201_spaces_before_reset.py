"""GK201."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


@check(
    "GK201",
    needs=("spaces",),
    severity=HIGH,
    mend="make the spaces of all possible agents in __init__, and return Gymnasium's spaces",
)
def spaces_exist_before_reset(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Every possible agent has its spaces at any time, already before the first reset.

    Trainers build networks and buffers from the observation and action spaces before they reset
    anything, and ask for them also when an agent has left.

    Bad:

        def reset(self, seed=None, options=None):
            self._spaces = {a: Discrete(5) for a in self.possible_agents}

    Good:

        def __init__(self):
            self._spaces = {a: Discrete(5) for a in self.possible_agents}
    """
    for fact in evidence.facts("spaces", "space"):
        value, agent = fact.value, fact.where.agent
        seen = f"{value['failed'] or 'a ' + value['type']}, {value['when']}"
        yield Occasion(
            fact.where, value["space"] is not None, "a Gymnasium space", seen,
            proof=_proof(str(agent), str(value["which"]), str(value["when"])),
        )  # fmt: skip


def _proof(agent: str, which: str, when: str) -> Proof:
    roster = "env.agents" if when == "live" else "env.possible_agents"
    lines = (
        f"agent = next(a for a in {roster} if str(a) == {agent!r})\n"
        f"space = env.{which}_space(agent)\n"
        "assert isinstance(space, gymnasium.spaces.Space), space"
    )
    if when == "before reset":
        return Proof(f"env = make()\n{lines}", plays=False, imports=("gymnasium",))
    again = "env.reset(seed=None if SEED is None else SEED + 1)\n"
    return Proof((again if when == "after another reset" else "") + lines, imports=("gymnasium",))
