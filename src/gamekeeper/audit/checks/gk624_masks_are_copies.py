"""GK624."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._written import none_of, written
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK624",
    needs=("written",),
    severity=MEDIUM,
    mend='hand out a copy of the mask: `{"action_mask": self.legal.copy()}`',
    applies=none_of("masks", "no action mask is handed out that can be written to"),
)
def written_masks_change_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Writing into an action mask, in an observation or an info, doesn't change what is legal.

    An agent that edits its mask, to forbid more to itself or by a normalisation in place, must not
    change the rules for itself or for others.

    Bad:

    ```python
    infos[agent] = {"action_mask": self.legal}      # the array that step() asks
    ```

    Good:

    ```python
    infos[agent] = {"action_mask": self.legal.copy()}
    ```
    """
    yield from written(evidence, "masks")
