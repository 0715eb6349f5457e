"""GK520."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK520",
    needs=("lifecycle",),
    severity=LOW,
    mend="return empty dictionaries (Parallel), or raise, once `agents` is empty",
)
def steps_end_with_the_episode(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A step after the end of the episode doesn't silently go on and return rewards or turns.

    A loop that forgets a reset then trains on an episode that isn't there. An exception of any kind
    is fine, and so are five empty dictionaries.

    Bad:
    ```python
    def step(self, actions):
        now = self.agents or self.possible_agents
        ...
    ```
    Good:
    ```python
    def step(self, actions):
        if not self.agents:
            return {}, {}, {}, {}, {}
    ```
    """
    for fact in evidence.facts("lifecycle", "after_end"):
        gave = fact.value["gave"]
        yield Occasion(
            fact.where, not gave, "an exception, or nothing",
            f"the step after the end gives {gave}", proof=fact.proof,
        )  # fmt: skip
