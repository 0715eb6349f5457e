"""GK614."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._kept import apart
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK614",
    needs=("kept",),
    severity=MEDIUM,
    mend="give each agent an array of its own: `{agent: view.copy() for agent in self.agents}`",
)
def observations_are_apart(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The observations of two agents share no memory that can be written to.

    A wrapper that normalises one agent's observation in place normalises the other's as well.
    Equal observations are fine, in arrays of their own or in one that is read-only.

    Bad:

    ```python
    view = self.board_view()
    return {agent: view for agent in self.agents}
    ```

    Good:

    ```python
    return {agent: self.board_view() for agent in self.agents}
    ```
    """
    yield from apart(evidence, "observations")
