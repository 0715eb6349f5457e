"""GK236."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import MEDIUM, Occasion, check
from gamekeeper.audit.checks._masks import lines, mask_of, movers
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


def _none_declared(contract: Contract, evidence: Gathered) -> str | None:
    is_declared = any(role.mask not in (None, "none") for role in contract.roles.values())
    return None if is_declared else "the contract says of no role where its mask stands"


@check(
    "GK236",
    needs=("rollout",),
    severity=MEDIUM,
    mend="put the mask where roles.<role>.mask says, or declare where it stands",
    applies=_none_declared,
)
def masks_stand_where_declared(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """A mask stands where the contract says it does, in each episode in which its agent moves.

    Policies look for it at that place, and take everything for legal where they find nothing.

    Bad:

        mask = "infos.action_mask"           # and the environment puts it into the observation

    Good:

        mask = "observation.action_mask"
    """
    for trace in evidence["rollout"]:
        first: dict[str, int] = {}
        found: set[str] = set()
        for turn in trace.turns:
            for agent in movers(evidence.api, turn):
                place = contract.mask_of(agent)
                if place is not None:
                    first.setdefault(agent, turn.index)
                    if mask_of(contract, turn, agent) is not None:
                        found.add(agent)
        for agent, turn_index in first.items():
            place = str(contract.mask_of(agent))
            yield Occasion(
                trace.at(turn_index, agent, place), agent in found,
                f"a mask at {place}", "nothing stands there",
                proof=f"{lines(evidence.api, agent, place)}\nassert mask is not None",
            )  # fmt: skip
