"""GK622."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._written import none_of, written
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK622",
    needs=("written",),
    severity=HIGH,
    mend="return a copy from state(): `return self.world.copy()`",
    applies=none_of("state", "it has no state() that only looks and hands out arrays"),
)
def written_states_change_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Writing into what state() handed out doesn't change the game.

    A central critic that normalises its input in place would move the agents themselves.

    Bad:

    ```python
    def state(self):
        return self.world
    ```

    Good:

    ```python
    def state(self):
        return self.world.copy()
    ```
    """
    yield from written(evidence, "state")
