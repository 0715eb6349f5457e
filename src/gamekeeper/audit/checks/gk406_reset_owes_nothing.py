"""GK406."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

PROOF: Final = """\
env.reset(seed=SEED)
assert env.last()[1] == 0, env.last()[1]
assert not any(env.rewards.values()), env.rewards
assert not any(env._cumulative_rewards.values()), env._cumulative_rewards  # what last() reads"""


@check(
    "GK406",
    needs=("books",),
    severity=HIGH,
    api="aec",
    mend="in reset(): `self.rewards = dict.fromkeys(self.agents, 0.0)`, and the same for "
    "`self._cumulative_rewards`",
)
def reset_owes_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A reset clears `rewards` and what `last()` tells: nothing of the last episode is owed.

    A reward of the episode before, told in the first turns of the next one, is credited to actions
    that had nothing to do with it.

    Bad:
    ```python
    def reset(self, seed=None, options=None):
        self.agents = self.possible_agents[:]     # the books of the last episode stay
    ```
    Good:
    ```python
    def reset(self, seed=None, options=None):
        self.agents = self.possible_agents[:]
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
    ```
    """
    for fact in evidence.facts("books", "owed"):
        books = {name: left for name, left in fact.value.items() if left}
        yield Occasion(
            fact.where, not books, "nothing owed after a reset",
            "; ".join(f"{name}: {left!r}" for name, left in books.items()), proof=PROOF,
        )  # fmt: skip
