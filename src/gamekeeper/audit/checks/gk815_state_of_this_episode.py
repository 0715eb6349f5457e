"""GK815."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._states import stateless
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

STEPS = {"parallel": "env.step(action)", "aec": "env.last()\n        env.step(action)"}
PROOF = """\
env = make()
def states():
    env.reset(seed=SEED)
    told = [np.array(env.state())]
    for action in ACTIONS:
        {step}
        told.append(np.array(env.state()))
    return told
first, second = states(), states()
assert all(map(np.array_equal, first, second)), 'the same play again has other states'
"""


@check(
    "GK815",
    needs=("state",),
    severity=MEDIUM,
    mend="forget in reset() whatever state() keeps",
    applies=stateless,
)
def states_forget_the_last_episode(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """state() is of this episode alone: after a reset nothing of the last one stands in it.

    The same play is played twice in one instance. Where all observations and rewards are equal, so
    must be the states.

    Bad:
        def state(self):
            if self.kept is None:
                self.kept = self.table()
            return self.kept             # step() forgets it, reset() doesn't

    Good:
        def reset(self, seed=None, options=None):
            self.kept = None
    """
    proof = Proof(PROOF.format(step=STEPS[evidence.api]), plays=False)
    for fact in evidence.facts("state", "used"):
        is_same = fact.value["turn"] is None
        seen = "the same" if is_same else "another"
        yield Occasion(fact.where, is_same, "the state that the same play had before", seen, proof)
