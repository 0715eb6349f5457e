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
    """Every possible agent has an observation and an action space, already before the first reset.

    Trainers build networks and buffers from the spaces before they reset anything.

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
            proof=_proof(str(agent), str(value["which"]), value["when"] == "before reset"),
        )  # fmt: skip


def _proof(agent: str, which: str, is_early: bool) -> Proof:
    roster = "env.possible_agents" if is_early else "env.agents"
    lines = (
        f"agent = next(a for a in {roster} if str(a) == {agent!r})\n"
        f"space = env.{which}_space(agent)\n"
        "assert isinstance(space, gymnasium.spaces.Space), space"
    )
    if is_early:
        return Proof(f"env = make()\n{lines}", plays=False, imports=("gymnasium",))
    return Proof(lines, imports=("gymnasium",))
