"""GK633."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._calls import extra, not_offered
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK633",
    needs=("extra_calls",),
    severity=MEDIUM,
    mend="build the spaces once, in __init__, and hand out the same ones at every call",
    applies=not_offered("spaces"),
)
def asking_for_spaces_changes_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Calling observation_space() and action_space() in mid-episode doesn't change the game.

    Policies and wrappers ask for spaces at any time, some of them at every step.

    Bad:

    ```python
    def action_space(self, agent):
        return Discrete(5, seed=int(self.rng.integers(1000)))       # draws at every call
    ```

    Good:

    ```python
    def action_space(self, agent):
        return self.action_spaces[agent]
    ```
    """
    yield from extra(evidence, "spaces")
