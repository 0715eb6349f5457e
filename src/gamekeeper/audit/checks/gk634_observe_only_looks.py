"""GK634."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._calls import extra, not_offered
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK634",
    needs=("extra_calls",),
    severity=HIGH,
    mend="keep noise and counters out of observe(): compute them in step()",
    api="aec",
    applies=not_offered("observe"),
)
def observing_changes_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Calling observe() again, for every agent, doesn't change the game.

    Loggers, wrappers and centralised learners observe more often than the loop. Where observe()
    draws from the game's generator or advances something, the game depends on who is watching.

    Bad:

    ```python
    def observe(self, agent):
        return self.position[agent] + self.rng.normal(size=2)      # draws at every look
    ```

    Good:

    ```python
    def step(self, action):
        ...
        self.noise = self.rng.normal(size=2)                        # once a turn
    ```
    """
    yield from extra(evidence, "observe")
