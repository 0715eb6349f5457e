"""GK621."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._written import none_of, written
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK621",
    needs=("written",),
    severity=HIGH,
    mend='put copies into infos: `{"action_mask": self.legal.copy()}`',
    applies=none_of("infos", "infos hold no array that can be written to"),
)
def written_infos_change_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Writing into an array of an info, such as its action mask, doesn't change the game.

    A learner that edits a mask to forbid more to itself must not change what the rules allow.

    Bad:

    ```python
    infos[agent] = {"action_mask": self.legal}      # the array that step() asks
    ```

    Good:

    ```python
    infos[agent] = {"action_mask": self.legal.copy()}
    ```
    """
    yield from written(evidence, "infos")
