"""GK402."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._ledger import is_dead_step
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


def _allowed(contract: Contract, evidence: Gathered) -> str | None:
    is_allowed = contract.after_end == "allowed"
    return "the contract allows rewards after the end" if is_allowed else None


@check(
    "GK402",
    needs=("rollout",),
    severity=HIGH,
    mend='pay an agent 0 once it has ended, or declare rewards.after_end = "allowed"',
    applies=_allowed,
)
def rewards_stop_at_the_end(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An agent that has ended is paid nothing more.

    Learners bootstrap past the end and credit the wrong action with a reward that comes later. What
    an agent earns by the step that ends it is paid by that very step.

    Bad:
    ```python
    for agent in self.possible_agents:        # also those that are gone
        rewards[agent] += team_bonus
    ```
    Good:
    ```python
    for agent in self.agents:
        rewards[agent] += team_bonus
    ```
    """
    for trace in evidence["rollout"]:
        ended: frozenset[str] = frozenset()
        for turn in trace.turns:
            ended = (ended - turn.live) | turn.ended  # who is live again is another check's
            if evidence.api == "aec" and is_dead_step(turn):
                continue  # what a dead step leaves standing is GK407's
            for agent in sorted(ended):
                paid = turn.rewards.get(agent, 0.0)
                yield Occasion(
                    trace.at(turn, agent, "rewards"), paid == 0.0, 0.0, paid,
                    proof=_proof(evidence.api, agent),
                )  # fmt: skip


def _proof(api: str, agent: str) -> str:
    rewards = "rewards" if api == "parallel" else "env.rewards"
    return (
        f"paid = {{str(a): r for a, r in {rewards}.items()}}\n"
        f"assert paid.get({agent!r}, 0) == 0, paid"
    )
