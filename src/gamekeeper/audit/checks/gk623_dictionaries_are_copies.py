"""GK623."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._written import written
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK623",
    needs=("written",),
    severity=MEDIUM,
    mend="return new dictionaries: `return observations, dict(self.rewards), ...`",
    api="parallel",
)
def emptied_dictionaries_change_nothing(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """Emptying the dictionaries that reset and step returned doesn't change the game.

    Wrappers take entries of agents that are gone out of them. Where they are the environment's own
    books, its next step crashes or forgets who has ended.

    Bad:

    ```python
    return observations, self.rewards, self.terminations, self.truncations, self.infos
    ```

    Good:

    ```python
    return observations, dict(self.rewards), dict(self.terminations), ...
    ```
    """
    yield from written(evidence, "dictionaries")
