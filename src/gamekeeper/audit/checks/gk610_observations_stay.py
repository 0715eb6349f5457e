"""GK610."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._kept import kept
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK610",
    needs=("kept",),
    severity=HIGH,
    mend="return a new array from every call (or a copy of the buffer), the mask's too",
)
def observations_stay_as_they_were(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An observation that was handed out doesn't change at a later turn.

    A replay buffer keeps observations by reference. Where the environment writes the next one into
    the same array, all that was learned from the earlier ones was learned from wrong data.

    Bad:

    ```python
    def observe(self, agent):
        self.planes[agent][...] = self.board == self.token[agent]
        return self.planes[agent]           # the same array at every turn
    ```

    Good:

    ```python
    def observe(self, agent):
        return (self.board == self.token[agent]).astype(np.int8)
    ```
    """
    yield from kept(evidence, "observations")
