"""GK523."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK523",
    needs=("lifecycle",),
    severity=HIGH,
    mend="let reset() make the whole state new, whatever the state of the episode before",
)
def resets_begin_anew(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A reset begins a new episode at any time: in mid-episode, after the end, twice in a row.

    Vector environments and evaluation loops reset whenever they like. A reset that raises, leaves
    nobody in `agents`, or is ignored until the episode is over, breaks them.

    Bad:
    ```python
    def reset(self, seed=None, options=None):
        if self.agents:
            return self._observations, self._infos    # not over yet
    ```
    Good:
    ```python
    def reset(self, seed=None, options=None):
        self.agents = self.possible_agents[:]
        self.board = new_board(self._rng)
    ```
    """
    for fact in evidence.facts("lifecycle", "reset"):
        raised, agents = fact.value["raised"], fact.value["agents"]
        yield Occasion(
            fact.where, raised is None and agents != 0, "a new episode that can be played",
            f"{fact.value['when']}: {raised or 'nobody is in agents'}", proof=fact.proof,
        )  # fmt: skip
    for fact in evidence.facts("lifecycle", "ignored"):
        yield Occasion(
            fact.where, not fact.value, "what the first reset with this seed gave",
            "a reset in mid-episode gives what stood there before it", proof=fact.proof,
        )  # fmt: skip
