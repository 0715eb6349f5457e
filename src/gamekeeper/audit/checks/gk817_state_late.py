"""GK817."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._states import stateless
from gamekeeper.audit.literal import literal
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

LEAST_TRIALS: Final = 4
STEPS: Final = {"parallel": "env.step(action)", "aec": "env.last()\n        env.step(action)"}
PROOF: Final = """\
TURN, OTHER = {turn}, {other}
def states(actions):
    env = make()
    env.reset(seed=SEED)
    told = [np.array(env.state())]
    for action in actions:
        {step}
        told.append(np.array(env.state()))
    return told
one = states(ACTIONS[: TURN + 2])
two = states([*ACTIONS[:TURN], OTHER, ACTIONS[TURN + 1]])
assert not np.array_equal(one[TURN + 1], two[TURN + 1]), 'the other action is shown later'
"""


@check(
    "GK817",
    needs=("state",),
    severity=MEDIUM,
    confidence=0.8,
    mend="make state() of what the step has led to, not of what it came from",
    applies=stateless,
)
def states_are_not_late(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """state() shows what a step has done at once, not a turn late.

    Another legal action is played at one turn. Where observations show the difference at once in
    four trials or more, while state() never does, and mostly does one turn later, it is late.

    Bad:
        def step(self, actions):
            self.kept = self.table()     # before anybody has moved
            ...

    Good:
        def state(self):
            return self.table()
    """
    for fact in evidence.facts("state", "late"):
        trials, later = fact.value["trials"], fact.value["later"]
        if fact.value["at_once"]:
            yield Occasion(fact.where, True, "shown at once", "shown at once")
        elif trials >= LEAST_TRIALS and later > trials / 2:
            seen = f"in none of {trials} trials, and in {later} of them a turn later"
            other = fact.value["other"]
            other = other if evidence.api == "parallel" else next(iter(other.values()))
            lines = PROOF.format(
                turn=fact.value["turn"], other=literal(other), step=STEPS[evidence.api]
            )
            proof = Proof(lines, plays=False)
            yield Occasion(fact.where, False, "shown at once", seen, proof)
