"""GK639."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._calls import extra, not_offered
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK639",
    needs=("extra_calls",),
    severity=MEDIUM,
    mend="let attributes and str() only read",
    applies=not_offered("attributes"),
)
def asking_for_attributes_changes_nothing(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """Reading num_agents, metadata, unwrapped or str(env) doesn't change the game.

    Progress bars, loggers and debuggers read them at any time.

    Bad:

    ```python
    @property
    def num_agents(self):
        self.purge()                    # takes out who has ended
        return len(self.agents)
    ```

    Good: whatever changes the game happens in `step`.
    """
    yield from extra(evidence, "attributes")
