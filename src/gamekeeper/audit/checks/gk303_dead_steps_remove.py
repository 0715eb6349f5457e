"""GK303."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._schedule import BEFORE_AND_AFTER, crossings
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

PROOF: Final = Proof(
    BEFORE_AND_AFTER + "assert not (ended and actor in env.agents), (actor, env.agents)",
    plays=False,
)


@check(
    "GK303",
    needs=("rollout",),
    severity=HIGH,
    api="aec",
    mend="remove a dead agent from `agents` in its None step, as `self._was_dead_step(action)` "
    "does",
)
def dead_steps_remove(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A dead agent has one None turn, which removes it: it isn't selected again.

    A loop over `agent_iter()` goes on until `agents` is empty. A dead agent that stays there is
    asked again and again; its last reward is read more than once, and the loop may never end.

    Bad:
    ```python
    if self.terminations[agent]:
        self.agent_selection = self._selector.next()      # and it comes round again
        return
    ```
    Good:
    ```python
    if self.terminations[agent]:
        return self._was_dead_step(action)
    ```
    """
    for play in crossings(evidence):
        for each in play:
            if each.is_dead:
                yield Occasion(
                    each.trace.at(each.turn + 1, each.actor, "agents"),
                    each.actor not in each.after, "gone after its None step",
                    "still in `agents`", proof=PROOF,
                )  # fmt: skip
