"""GK221."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._illegal import proof
from gamekeeper.audit.checks._legal import legal_turns
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

PROOF = "# nothing more: a step above raised, and every action in it is one of its action space"


@check(
    "GK221",
    needs=("rollout", "spaces", "illegal"),
    severity=HIGH,
    mend="take every action of the action space, make the space smaller, or give an action mask",
)
def actions_of_the_space_are_accepted(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Every action of the action space is accepted: `step` raises nothing.

    A policy chooses from the action space and knows no other rule, unless a mask tells it. A step
    that raises ends a training after hours, mostly in a corner that random play seldom reaches: at
    the very bounds of a Box, or with an action that is an int and no np.int64.

    Bad:

        self.action_spaces[agent] = Discrete(6)        # and action 5 is an index past the end

    Good:

        self.action_spaces[agent] = Discrete(5)
    """
    for fact in evidence.facts("illegal", "rare"):
        raised = fact.value["raised"]
        yield Occasion(
            fact.where, raised is None, "a step that takes an action of the space", raised,
            proof=proof(evidence.api, fact.where.turn, fact.value, "assert error is None, error"),
        )  # fmt: skip
    for taken in legal_turns(contract, evidence):
        if not taken.is_masked:
            yield Occasion(
                taken.trace.at(taken.turn, taken.agent, "raised"), taken.raised is None,
                "a step that takes actions of the action space", taken.raised, proof=PROOF,
            )  # fmt: skip
