"""GK635."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._calls import extra, not_offered
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

TWICE = """\
first, second = env.last(), env.last()
assert first[1:4] == second[1:4], (first[1:4], second[1:4])"""


@check(
    "GK635",
    needs=("extra_calls",),
    severity=HIGH,
    mend="leave last() as AECEnv has it, and compute in step() what it shows",
    api="aec",
    applies=not_offered("last"),
)
def asking_last_changes_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Calling last() twice in a turn tells the same twice, and doesn't change the game.

    Wrappers call last() beside the loop that plays. Where it pays out, clears or draws, the second
    call gets something else, and so does everybody after it.

    Bad:

    ```python
    def last(self, observe=True):
        out = super().last(observe)
        self._cumulative_rewards[self.agent_selection] = 0     # paid out by being asked
        return out
    ```

    Good: clear the agent's cumulative reward in its own `step`.
    """
    yield from extra(evidence, "last")
    for fact in evidence.facts("extra_calls", "twice"):
        told = fact.value["told"]
        for _ in range(fact.value["looks"] - (told is not None)):
            yield Occasion(fact.where, True)
        if told is not None:
            yield Occasion(
                fact.where, False, f"reward and flags {told[0]} again", f"{told[1]}", proof=TWICE
            )
