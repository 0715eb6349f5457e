"""GK611."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._kept import kept
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK611",
    needs=("kept",),
    severity=MEDIUM,
    mend="build a new info for every step, with copies of arrays such as action masks",
)
def infos_stay_as_they_were(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An info that was handed out, an action mask in it too, doesn't change at a later turn.

    Whoever keeps infos, masks above all, for learning later finds those of another turn.

    Bad:

    ```python
    self.infos[agent]["action_mask"] = self.legal       # one array, written to at every step
    ```

    Good:

    ```python
    self.infos[agent] = {"action_mask": self.legal.copy()}
    ```
    """
    yield from kept(evidence, "infos")
