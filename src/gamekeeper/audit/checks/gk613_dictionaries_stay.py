"""GK613."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._kept import kept
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK613",
    needs=("kept",),
    severity=MEDIUM,
    mend="return new dictionaries from every step: `return obs, dict(self.rewards), ...`",
    api="parallel",
)
def dictionaries_stay_as_they_were(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The dictionaries of rewards and endings that step returned don't change at a later step.

    A rollout that is kept step by step, as every learner does, holds the last step's rewards again
    and again. (The attributes of an AEC environment are another thing: those are written in place.)

    Bad:

    ```python
    for agent in self.agents:
        self.rewards[agent] = self.score(agent)
    return observations, self.rewards, ...
    ```

    Good:

    ```python
    rewards = {agent: self.score(agent) for agent in self.agents}
    return observations, rewards, ...
    ```
    """
    yield from kept(evidence, "rewards", "terminations", "truncations")
