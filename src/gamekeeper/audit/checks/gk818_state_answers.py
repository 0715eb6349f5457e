"""GK818."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._states import answers, at, stateless
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK818",
    needs=("state",),
    severity=MEDIUM,
    mend="let state() answer at any time after reset(), whoever is still alive",
    applies=stateless,
)
def states_answer_all_along(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """state() answers at every turn of a play, once it is there at all.

    Collectors ask for it after every step. What it does once the episode is over isn't judged.

    Bad:
        return np.concatenate([self.rows[agent] for agent in self.possible_agents])   # KeyError

    Good:
        return np.concatenate([self.row(agent) for agent in self.possible_agents])
    """
    for fact, answer in answers(evidence):
        failed = answer["failed"]
        if failed is None or not answer["over"]:
            where = at(fact, answer)
            yield Occasion(where, failed is None, "a state", failed or "a state", "env.state()")
