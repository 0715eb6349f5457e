"""GK312."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.audit.checks.gk311_order_free_outcome import LEVEL, proof_of_order
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK312",
    needs=("order",),
    severity=LOW,
    mend="draw in the order of `self.agents`, not in that of the dictionary that was handed over",
    confidence=0.9,
    api="parallel",
)
def draws_are_free_of_the_actions_order(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """Random draws don't come in the order of the action dictionary.

    The game is the same on average, but with one seed two trainers that list agents in another
    order see other episodes, and no rollout can be repeated from seed and actions by name.

    As GK311, which tells a change of draws from a change of the outcome: here are the plays in
    which the two orders differ, something was drawn, and no test tells their distributions apart.

    Bad:

        for agent, action in actions.items():
            if self.rng.random() < 0.9:        # the draw goes to who stands first
                self.move(agent, action)

    Good:

        for agent in self.agents:
            if self.rng.random() < 0.9:
                self.move(agent, actions[agent])
    """
    for fact in evidence.facts("order", "order"):
        value = fact.value
        is_drawn = value["result"] in ("draws", "undecided")
        if is_drawn and min(value["p_values"], default=1.0) <= LEVEL:
            continue  # the outcome, which GK311 tells
        if is_drawn or value["result"] in ("same", "rounding"):
            yield Occasion(
                fact.where, not is_drawn,
                "the same episode whatever the order of the dictionary",
                f"another one from turn {value.get('turn')} on, with the same chances",
                proof=proof_of_order(value.get("order", "reversed")),
            )  # fmt: skip
