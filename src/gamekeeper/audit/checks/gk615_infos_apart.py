"""GK615."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._kept import apart
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK615",
    needs=("kept",),
    severity=MEDIUM,
    mend="`{agent: {} for agent in self.agents}`, not `dict.fromkeys(self.agents, {})`",
)
def infos_are_apart(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The infos of two agents are not one dictionary, nor do they share an array.

    What is put into one agent's info, by a wrapper for instance, stands in the other's too.

    Bad:

    ```python
    infos = dict.fromkeys(self.agents, {})
    ```

    Good:

    ```python
    infos = {agent: {} for agent in self.agents}
    ```
    """
    yield from apart(evidence, "infos")
