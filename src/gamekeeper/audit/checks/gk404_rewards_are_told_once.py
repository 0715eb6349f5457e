"""GK404."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._ledger import PROOF, all_told
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK404",
    needs=("rollout", "books"),
    severity=HIGH,
    api="aec",
    mend="set `self._cumulative_rewards[agent] = 0` for the agent that acts, before rewards are "
    "accumulated, and accumulate once in a step",
)
def rewards_are_told_once(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """`last()` tells each reward once: cumulative rewards are cleared when their agent acts.

    Where `_cumulative_rewards` isn't cleared, `last()` gives the return so far, and a learner
    counts the first reward of an episode once for every turn; accumulated twice in a step, every
    reward counts double.

    Bad:
    ```python
    self.rewards[agent] = 1.0
    self._accumulate_rewards()                # on top of what the agent has been told
    ```
    Good:
    ```python
    self._cumulative_rewards[agent] = 0
    self._clear_rewards()
    self.rewards[agent] = 1.0
    self._accumulate_rewards()
    ```
    """
    for told, kind in all_told(evidence):
        more = {
            "carried": f", with the {told.carried!r} that it gave at the turn before",
            "again": ", the same more than once",
        }.get(kind, "")
        yield Occasion(
            told.trace.at(told.turn, told.agent, "received"), kind not in ("carried", "again"),
            f"{told.owed!r}, the sum of `rewards` since its last turn",
            f"last() gives {told.told!r}{more}", proof=PROOF,
        )  # fmt: skip
