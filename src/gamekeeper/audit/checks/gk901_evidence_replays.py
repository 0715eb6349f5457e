"""GK901."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._twins import judged
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof

PROOF = "assert not any('object at' in repr(each) for each in ACTIONS), 'these are no values'"


@check(
    "GK901",
    needs=("evidence",),
    severity=HIGH,
    mend="take actions as numbers, texts and arrays in an ordinary space, and let step() depend on "
    "their values alone",
)
def evidence_replays(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A play replays bit for bit from its evidence: seed, options and the actions as they were written.

    What is recorded is all that a later reader has. Where the same actions from the same seed give
    another play already, nothing is said here: then it is the seed that doesn't settle the game.

    Bad:
        class Orders(gymnasium.Space):
            def sample(self, mask=None):
                return Order(self.np_random)       # an object that no file holds

    Good:
        self.action_spaces = {agent: Discrete(5) for agent in self.possible_agents}
    """  # noqa: E501  # the claim is one line
    for twin in evidence.twins("evidence"):
        yield from judged(twin, "the play as it was recorded", Proof(PROOF))
    for fact in evidence.facts("evidence", "unwritten"):
        yield Occasion(fact.where, False, "actions that can be written", fact.value, proof=PROOF)
