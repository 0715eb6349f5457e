"""GK612."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._kept import kept, without_state
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK612",
    needs=("kept",),
    severity=HIGH,
    mend="return a copy from state(): `return self.world.copy()`",
    applies=without_state,
)
def states_stay_as_they_were(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """What state() handed out doesn't change at a later turn.

    A central critic that keeps states by reference learns from the last one alone.

    Bad:

    ```python
    def state(self):
        return self.world               # the array that step() writes to
    ```

    Good:

    ```python
    def state(self):
        return self.world.copy()
    ```
    """
    yield from kept(evidence, "state")
