"""GK526."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK526",
    needs=("ended",),
    severity=MEDIUM,
    api="parallel",
    mend="read the actions of agents in `agents` only, or raise where there are others",
)
def the_ended_dont_act(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An agent that has ended acts no more: its entry in the actions is ignored or refused.

    Trainers with a fixed number of slots go on sending actions for those that are gone. Where these
    still move something, the game depends on what isn't in it. Looked at with two different actions
    of agents that have ended, and with none, everything else being equal.

    Bad:
    ```python
    for agent, action in actions.items():
        self.move(agent, action)
    ```
    Good:
    ```python
    for agent in self.agents:
        self.move(agent, actions[agent])
    ```
    """
    for fact in evidence.facts("ended", "ended_acts"):
        turn, agents = fact.value["turn"], fact.value["agents"]
        yield Occasion(
            fact.where, turn is None, "the same play, whatever those who ended do",
            f"another one from turn {turn} on, by what {agents} did", proof=fact.proof,
        )  # fmt: skip
