"""GK631."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._handed import nothing_handed
from gamekeeper.audit.story import OVERWRITE, crossings_of, parting_words
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

PARALLEL = """
def story(meddles):
    env = make()
    told = [copy.deepcopy(env.reset(seed=SEED))]
    for actions in copy.deepcopy(ACTIONS):
        told.append(copy.deepcopy(env.step(actions)))
        if meddles:
            overwrite(actions)
            actions.clear()
    return told
"""
AEC = """
def story(meddles):
    env = make()
    env.reset(seed=SEED)
    told = []
    for action in copy.deepcopy(ACTIONS):
        told.append((env.agent_selection, copy.deepcopy(env.last())))
        env.step(action)
        told.append(dict(env.rewards))
        if meddles:
            overwrite(action)
    if env.agents:
        told.append(copy.deepcopy(env.last()))
    return told
"""


@check(
    "GK631",
    needs=("handed_over",),
    severity=HIGH,
    mend="keep a copy of what is needed after the step: `self.last_action = np.array(action)`",
    applies=nothing_handed("handed", "actions are plain numbers, which nobody can write into"),
)
def actions_are_read_in_their_step(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Writing into an action after its step doesn't change the game: step keeps no reference.

    Learners re-use their buffers of actions. Where the environment reads an earlier action again,
    for an observation or for inertia, it reads the later one.

    Bad:

    ```python
    self.last_actions = actions                     # read when the next observation is made
    ```

    Good:

    ```python
    self.last_actions = {agent: np.array(actions[agent]) for agent in actions}
    ```
    """
    for twin in evidence.twins("handed_over"):
        parting = twin.divergence
        if twin.noise is not None:
            continue
        if parting is None:
            yield Occasion(twin.base.at(None, None, "kept"), True)
            continue
        lines = OVERWRITE + (PARALLEL if evidence.api == "parallel" else AEC)
        lines += "\nnp.testing.assert_equal(story(True), story(False))"
        yield Occasion(
            twin.base.at(crossings_of(parting), None, "kept"), False,
            "the play goes on as if nothing was written", parting_words(parting),
            proof=Proof(lines, plays=False, imports=("copy",)),
        )  # fmt: skip
