"""GK816."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._states import stateless
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

LEAST_MOVES: Final = 8
"""Turns at which observations changed, before a state that stays says anything."""
STEPS: Final = {
    "parallel": "    env.step(action)\n",
    "aec": "    env.last()\n    env.step(action)\n",
}
PROOF: Final = (
    "env = make()\nenv.reset(seed=SEED)\nstates = [np.array(env.state())]\n"
    "for action in ACTIONS:\n{step}    states.append(np.array(env.state()))\n"
    "assert any(not np.array_equal(states[0], state) for state in states), 'it never changes'"
)


@check(
    "GK816",
    needs=("state",),
    severity=MEDIUM,
    confidence=0.9,
    mend="make state() from what step() changes",
    applies=stateless,
)
def states_follow_the_game(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """state() follows the game: while observations change over a whole play, it does too.

    A central critic learns nothing from a state that stands still. Only plays in which somebody's
    observation changed at eight turns or more are looked at; one other state in any play is enough.

    Bad:
        def state(self):
            return self.start_table

    Good:
        def state(self):
            return self.table()
    """
    looks = [
        (fact, {a["digest"] for a in fact.value["answers"] if a["failed"] is None})
        for fact in evidence.facts("state", "states")
        if fact.value["moves"] >= LEAST_MOVES
    ]
    looks = [(fact, states) for fact, states in looks if states]
    if looks:
        is_ok = any(len(states) > 1 for _, states in looks)
        where = replace(looks[0][0].where, turn=None, field="states")
        proof = Proof(PROOF.format(step=STEPS[evidence.api]), plays=False)
        seen = "it changes" if is_ok else "one state from the reset to the end"
        yield Occasion(where, is_ok, "states that change as the game moves", seen, proof)
