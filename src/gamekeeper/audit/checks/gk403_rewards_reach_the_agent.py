"""GK403."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._ledger import PROOF, all_told
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK403",
    needs=("rollout", "books"),
    severity=HIGH,
    api="aec",
    mend="in step(): set `self._cumulative_rewards[agent] = 0` for the agent that acts, clear "
    "`rewards`, set them, and call `self._accumulate_rewards()` last, on every path",
)
def rewards_reach_the_agent(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Every reward is accumulated: `last()` gives all that was paid since the agent's last turn.

    Who reads `last()` learns from what it says. Rewards that are set and never accumulated,
    accumulated before they are set, or cleared before their agent's turn came, are lost to it or
    come with the wrong turn; an ended agent reads its last reward at its None turn.

    Bad:
    ```python
    self._accumulate_rewards()                # the old ones
    self.rewards[agent] = 1.0
    ```
    Good:
    ```python
    self._cumulative_rewards[agent] = 0       # who acts has been told
    self._clear_rewards()
    self.rewards[agent] = 1.0
    self._accumulate_rewards()
    ```
    """
    for told, kind in all_told(evidence):
        yield Occasion(
            told.trace.at(told.turn, told.agent, "received"), kind != "lost",
            f"{told.owed!r}, the sum of `rewards` since its last turn",
            f"last() gives {told.told!r}", proof=PROOF,
        )  # fmt: skip
