"""GK814."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._states import answers, at, stateless
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

PROOF = (
    "first, second = env.state(), env.state()\n"
    "assert np.array_equal(first, second), 'state() is another when it is asked again'"
)


@check(
    "GK814",
    needs=("state",),
    severity=MEDIUM,
    mend="make state() a function of the game alone; noise belongs into observations, drawn in "
    "step()",
    applies=stateless,
)
def states_are_the_same_asked_twice(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """state() says the same when it is asked twice at one moment: it neither draws nor counts.

    What differs from one call to the next isn't the game's state; if it is drawn from the game's
    own generator, asking also changes the future.

    Bad:
        return self.table() + self.rng.normal(0, 0.01, 12)

    Good:
        return self.table()
    """
    for fact, answer in answers(evidence):
        if answer["failed"] is None:
            is_same = answer["digest"] == answer["again"]
            seen = "the same" if is_same else "another"
            yield Occasion(at(fact, answer), is_same, "the same state twice", seen, PROOF)
