"""GK620."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._written import none_of, written
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK620",
    needs=("written",),
    severity=HIGH,
    mend="return copies: no array that the rules, or a cache, will read again",
    applies=none_of("observations", "observations hold no array that can be written to"),
)
def written_observations_change_nothing(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """Writing into an observation doesn't change the game.

    Wrappers and learners scale observations in place. Where those are the game's own arrays, an
    agent moves pieces by looking at them.

    Bad:

    ```python
    def observe(self, agent):
        return self.board
    ```

    Good:

    ```python
    def observe(self, agent):
        return self.board.copy()
    ```
    """
    yield from written(evidence, "observations")
