"""GK302."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._schedule import BEFORE_AND_AFTER, crossings
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

PROOF: Final = Proof(
    BEFORE_AND_AFTER + "gone = set(before) - set(env.agents)\n"
    "assert gone <= ({actor} if ended else set()), (gone, 'left with the step of', actor)",
    plays=False,
)


@check(
    "GK302",
    needs=("rollout",),
    severity=HIGH,
    api="aec",
    mend="leave an agent that has ended in `agents` with its flag set until it was selected for "
    "its None step, as `self._deads_step_first()` and `self._was_dead_step(action)` do",
)
def dead_agents_get_their_turn(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An agent that ends is selected once more before it is removed, for its None turn.

    That turn is where its learner reads the last reward and that it has ended, with `last()`. An
    agent that is removed by somebody else's step, or with the step that ends it, never hears of
    either.

    Bad:
    ```python
    if money[agent] <= 0:
        self.agents.remove(agent)
    ```
    Good:
    ```python
    if money[agent] <= 0:
        self.terminations[agent] = True
    ...
    self._deads_step_first()
    ```
    """
    for play in crossings(evidence):
        for each in play:
            if each.before == each.after:
                continue
            for agent in sorted(set(each.before) - set(each.after)):
                if not _may_leave(contract, agent):
                    is_own = agent == each.actor and each.is_dead
                    yield Occasion(
                        each.trace.at(each.turn + 1, agent, "agents"), is_own,
                        "removed by its own None step",
                        f"removed by the step of {each.actor!r}, so its end can't be read",
                        proof=PROOF,
                    )  # fmt: skip


def _may_leave(contract: Contract, agent: str) -> bool:
    name = contract.role_of(agent)
    return bool(name is not None and contract.roles[name].may_leave)
