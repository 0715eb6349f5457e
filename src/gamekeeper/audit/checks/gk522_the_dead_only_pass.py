"""GK522."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK522",
    needs=("lifecycle",),
    severity=MEDIUM,
    api="aec",
    mend="hand the action on: `self._was_dead_step(action)` raises where it isn't None",
)
def the_dead_only_pass(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A dead agent's only action is None: a real action of an agent that has ended is refused.

    A loop that forgets to look at the flags would go on choosing for an agent that isn't there any
    more, and nobody would hear of it. An exception of any kind is fine.

    Bad:
    ```python
    if self.terminations[agent]:
        self._was_dead_step(None)             # whatever the action was
        return
    ```
    Good:
    ```python
    if self.terminations[agent]:
        return self._was_dead_step(action)
    ```
    """
    for fact in evidence.facts("lifecycle", "dead_action"):
        yield Occasion(
            fact.where, fact.value["raised"] is not None, "an exception",
            f"{fact.value['agent']!r} has ended, and its action is accepted", proof=fact.proof,
        )  # fmt: skip
