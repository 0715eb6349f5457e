"""GK235."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._legal import legal_turns
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

PROOF = "# nothing more: a step above raised, and the masks given before it allow all its actions"


@check(
    "GK235",
    needs=("rollout", "spaces"),
    severity=HIGH,
    mend="make the mask from the state that the action will meet, for the agent that will act",
)
def allowed_actions_are_accepted(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """Every action that an action mask allows is accepted: the mask is neither wrong nor stale.

    A mask that was made before the last move, for another agent, or the wrong way round offers
    actions that the rules refuse.

    Bad:

        mask = board == 0                  # kept from before the other player's move

    Good:

        def observe(self, agent): return {..., "action_mask": self._legal_now(agent)}
    """
    for taken in legal_turns(contract, evidence):
        if taken.is_masked:
            yield Occasion(
                taken.trace.at(taken.turn, taken.agent, "raised"), taken.raised is None,
                "a step that takes what the masks allow", taken.raised, proof=PROOF,
            )  # fmt: skip
