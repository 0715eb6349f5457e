"""GK638."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._calls import extra, not_offered
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK638",
    needs=("extra_calls",),
    severity=HIGH,
    mend="draw from the environment's own generator, never from a space's `np_random`",
    applies=not_offered("sample"),
)
def sampling_a_space_changes_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Sampling from the spaces that are handed out doesn't change the game.

    Every random policy samples actions. Where the game draws from the generators of its spaces,
    what happens depends on how often anybody has sampled.

    Bad:

    ```python
    wind = self.action_space(agent).sample()
    ```

    Good:

    ```python
    wind = self.rng.integers(5)
    ```
    """
    yield from extra(evidence, "sample")
