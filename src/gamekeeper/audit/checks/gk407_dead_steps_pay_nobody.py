"""GK407."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._ledger import is_dead_step
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof
from gamekeeper.core.trace import Turn

PROOF: Final = Proof(
    """\
env = make()
env.reset(seed=SEED)
for action in ACTIONS:
    before = dict(env.rewards)
    env.last()
    env.step(action)
again = {agent: reward for agent, reward in env.rewards.items() if reward}
assert not again, ("after the None step of a dead agent", before, again)""",
    plays=False,
)


@check(
    "GK407",
    needs=("rollout",),
    severity=MEDIUM,
    api="aec",
    mend="clear `rewards` in the None step of a dead agent, as `self._was_dead_step(None)` does",
)
def dead_steps_pay_nobody(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The None step of a dead agent pays nobody: rewards from before it are cleared, not left over.

    What still stands in `rewards` after such a step is counted again by everybody who sums it up: a
    converter to the Parallel API, a recorder, a score.

    Bad:
    ```python
    if self.terminations[agent]:
        self.agents.remove(agent)             # `rewards` of the others is as it was
        return
    ```
    Good:
    ```python
    if self.terminations[agent]:
        self._was_dead_step(action)
    Return:
    ```
    """
    for trace in evidence["rollout"]:
        stood: Mapping[str, float] = {}
        ended: set[str] = set()
        for turn in trace.turns:
            ended |= turn.ended
            if is_dead_step(turn):
                left = _left(turn, stood, ended)
                yield Occasion(
                    trace.at(turn, turn.order[0], "rewards"), not left,
                    "nobody is paid by a dead agent's step", f"rewards after it: {left!r}",
                    proof=PROOF,
                )  # fmt: skip
            stood = turn.rewards


def _left(turn: Turn, stood: Mapping[str, float], ended: set[str]) -> dict[str, float]:
    """Rewards after a dead step that were there before it, or that pay who has ended."""
    return {
        agent: reward
        for agent, reward in turn.rewards.items()
        if reward and (agent in ended or stood.get(agent) == reward)
    }
