"""GK230."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._masks import fits, lines, masks
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK230",
    needs=("rollout", "spaces"),
    severity=HIGH,
    mend="give a mask with one number for each action of the agent's action space",
)
def masks_fit_the_action_space(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An action mask has one number for each action of its agent, no more and no fewer.

    A mask of another length, or of another agent's action space, can't be laid over what a policy
    may choose: some actions are never offered, or choosing crashes.

    Bad:

        spaces.Discrete(5); mask = np.ones(4, np.int8)      # "stay" was forgotten

    Good:

        spaces.Discrete(5); mask = np.ones(5, np.int8)
    """
    for each in masks(contract, evidence):
        where = each.trace.at(each.turn, each.agent, each.place)
        fault = fits(each.space, each.mask)
        if fault is None:
            yield Occasion(where, True)
            continue
        expected, _, seen = fault.partition(", seen ")
        proof = lines(evidence.api, each.agent, each.place)
        yield Occasion(
            where, False, expected, seen,
            proof=f"{proof}\nenv.action_space(agent).sample(mask)",
        )  # fmt: skip
