"""GK630."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._handed import handed, nothing_handed
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

PARALLEL = """\
env = make()
env.reset(seed=SEED)
for actions in ACTIONS:
    before = copy.deepcopy(actions)
    env.step(actions)
    np.testing.assert_equal(actions, before)"""
AEC = """\
env = make()
env.reset(seed=SEED)
for action in ACTIONS:
    before = copy.deepcopy(action)
    env.last()
    env.step(action)
    np.testing.assert_equal(action, before)"""


@check(
    "GK630",
    needs=("handed_over",),
    severity=HIGH,
    mend="compute with a copy: `push = 0.1 * actions[agent]`, not `actions[agent] *= 0.1`",
    applies=nothing_handed("handed", "actions are plain numbers, which nobody can write into"),
)
def step_leaves_actions_alone(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The actions that are handed to step, and their dictionary, are as before once it returns.

    A replay buffer keeps the action that was chosen. Where step scales or clips the caller's array
    in place, the learner is told that it had chosen something else.

    Bad:

    ```python
    push = actions[agent]
    push *= 0.1
    ```

    Good:

    ```python
    push = 0.1 * actions[agent]
    ```
    """
    lines = PARALLEL if evidence.api == "parallel" else AEC
    yield from handed(evidence, "handed", Proof(lines, plays=False, imports=("copy",)))
