"""GK521."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK521",
    needs=("lifecycle",),
    severity=LOW,
    confidence=0.8,
    mend="raise an error in step() while no reset has been made",
)
def steps_begin_with_a_reset(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A step before the first reset doesn't silently play: it raises, or gives nothing.

    An episode that nobody has reset has no seed: it can't be played again, and its first state may
    be one that no episode begins with. An exception of any kind is fine.

    Bad:
    ```python
    def __init__(self):
        self.agents = self.possible_agents[:]     # and step() plays on from here
    ```
    Good:
    ```python
    def step(self, actions):
        if self.state is None:
            raise RuntimeError("call reset() before step()")
    ```
    """
    for fact in evidence.facts("lifecycle", "unborn_step"):
        gave = fact.value["gave"]
        yield Occasion(
            fact.where, not gave, "an exception, or nothing",
            f"the step before any reset gives {gave}", proof=fact.proof,
        )  # fmt: skip
