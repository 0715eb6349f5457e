"""GK405."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof


@check(
    "GK405",
    needs=("books",),
    severity=HIGH,
    api="aec",
    mend="call `self._clear_rewards()` at the start of every step of a live agent",
)
def rewards_are_made_anew(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """`rewards` is cleared in every step: it holds what that step paid, nothing from before.

    A reward that still stands after the next step is accumulated again, once for every step until
    something overwrites it; a converter to the Parallel API counts it as often. Looked at by
    marking a reward before a step and looking for the mark after it.

    Bad:
    ```python
    def step(self, action):
        ...
        self.rewards[agent] = gain            # everybody else's still stands
        self._accumulate_rewards()
    ```
    Good:
    ```python
    def step(self, action):
        ...
        self._clear_rewards()
        self.rewards[agent] = gain
        self._accumulate_rewards()
    ```
    """
    for fact in evidence.facts("books", "stands"):
        seen = fact.value
        yield Occasion(
            fact.where, not seen["stood"], "made by the step alone",
            f"the reward {seen['reward']!r} from before the step still stands after it",
            proof=_proof(seen["agent"]),
        )  # fmt: skip


def _proof(agent: Any) -> Proof:
    lines = f"""\
env = make()
env.reset(seed=SEED)
for action in ACTIONS[:-1]:
    env.last()
    env.step(action)
env.rewards[{agent!r}] += 1e6  # a mark, which the next step must clear
env.last()
env.step(ACTIONS[-1])
assert env.rewards.get({agent!r}, 0) < 5e5, env.rewards"""
    return Proof(lines, plays=False)
