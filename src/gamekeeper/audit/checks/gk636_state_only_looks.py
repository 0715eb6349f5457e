"""GK636."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._calls import extra, not_offered
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK636",
    needs=("extra_calls",),
    severity=HIGH,
    mend="let state() only read: draw noise in step(), or from a generator of its own",
    applies=not_offered("state"),
)
def asking_for_the_state_changes_nothing(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """Calling state() doesn't change the game, nor draw from its generator.

    Centralised critics ask for the state at every step, evaluations don't: with one seed they play
    different games.

    Bad:

    ```python
    def state(self):
        return self.table() + self.rng.normal(0, 0.01, self.shape)
    ```

    Good:

    ```python
    def state(self):
        return self.table()
    ```
    """
    yield from extra(evidence, "state")
