"""GK501."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK501",
    needs=("rollout",),
    severity=HIGH,
    mend="set the agent's termination or truncation in the step that takes it out of `agents`, "
    "or declare may_leave for its role",
)
def agents_leave_by_ending(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An agent leaves `agents` only once it has terminated or truncated.

    A learner that sees no end waits for an agent that never acts again, and bootstraps from
    nothing.
    """
    for trace in evidence["rollout"]:
        live: frozenset[str] = frozenset()
        ended: set[str] = set()
        for turn in trace.turns:
            ended |= turn.ended
            now = turn.live if evidence.api == "parallel" else live
            for agent in sorted(live - now):
                if not _may_leave(contract, agent):
                    yield Occasion(
                        trace.at(turn, agent, "agents"), agent in ended,
                        "a termination or a truncation", "it is gone without either",
                        proof=_proof(agent),
                    )  # fmt: skip
            live = now


def _may_leave(contract: Contract, agent: str) -> bool:
    name = contract.role_of(agent)
    return bool(name is not None and contract.roles[name].may_leave)


def _proof(agent: str) -> str:
    return (
        f"gone = {agent!r} not in env.agents\n"
        f"flags = terminations.get({agent!r}), truncations.get({agent!r})\n"
        f"assert not gone or any(flags), flags"
    )
