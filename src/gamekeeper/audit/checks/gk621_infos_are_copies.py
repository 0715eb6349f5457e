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
    mend='put copies into infos: `{"position": self.position.copy()}`',
    applies=none_of("infos", "infos hold no array that can be written to"),
)
def written_infos_change_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Writing into an array of an info doesn't change the game.

    Wrappers scale what they find there in place. Where it is the game's own array, they move it.

    Bad:

    ```python
    infos[agent] = {"position": self.position[agent]}       # a view of the game's own array
    ```

    Good:

    ```python
    infos[agent] = {"position": self.position[agent].copy()}
    ```
    """
    yield from written(evidence, "infos")
