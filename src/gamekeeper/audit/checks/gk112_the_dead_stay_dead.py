"""GK112."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._rosters import plays_with_rosters
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.trace import Trace


@check(
    "GK112",
    needs=("rollout",),
    severity=HIGH,
    mend="keep an agent that will be back in `agents` without ending it, or let a new one join "
    "under a name that wasn't used in this episode",
)
def nobody_comes_back_within_an_episode(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """An agent that has ended and left isn't revived under the same name in the same episode.

    Learners close its trajectory when it ends: what it does afterwards is glued to the dead one or
    lost, and returns are counted twice.

    Bad: `self.agents.append(prey)` some steps after the prey was eaten.

    Good: a prey that is eaten is set down elsewhere without ending, or `prey_7` joins for `prey_3`.
    """
    for trace, rosters in plays_with_rosters(evidence):
        gone: set[str] = set()
        live: set[str] = set(rosters[0]) if rosters else set()
        for turn, names in enumerate(rosters):
            gone |= live - set(names)
            live = set(names)
            back = sorted(live & gone)
            back = [agent for agent in back if not _may_return(contract, trace, agent, turn)]
            if gone:
                yield Occasion(
                    trace.at(turn, back[0] if back else None, "agents"), not back,
                    "gone for the rest of the episode", f"back: {', '.join(back)}",
                    proof=_proof(evidence.api),
                )  # fmt: skip
            gone -= live


def _may_return(contract: Contract, trace: Trace, agent: str, turn: int) -> bool:
    """Declared free to leave and join, and didn't end before."""
    role = contract.roles.get(contract.role_of(agent) or "")
    if role is None or not (role.may_leave and role.may_join):
        return False
    return not any(agent in each.ended for each in trace.turns if each.index < turn)


def _proof(api: str) -> str:
    crossing = "env.step(each)" if api == "parallel" else "env.last(), env.step(each)"
    return (
        "env.reset(seed=SEED)\nlive, gone = set(env.agents), set()\n"
        f"for each in ACTIONS:\n    {crossing}\n"
        "    gone |= live - set(env.agents)\n    live = set(env.agents)\n"
        "    assert not live & gone, live & gone"
    )
