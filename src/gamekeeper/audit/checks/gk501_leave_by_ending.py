"""GK501."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._endings import ended_in, is_twofold
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

PROOF = """\
gone = [agent for agent in ACTIONS[-1] if agent not in env.agents]
silent = [a for a in gone if not terminations.get(a) and not truncations.get(a)]
assert not silent, silent"""


@check(
    "GK501",
    needs=("rollout",),
    severity=HIGH,
    mend="set the agent's termination or truncation in the step that takes it out of `agents`, "
    "or declare may_leave for its role",
    api="parallel",
)
def agents_leave_by_ending(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An agent leaves `agents` only once it has terminated or truncated, and the flag says so.

    A learner that sees no end waits for an agent that never acts again, and bootstraps from
    nothing.

    Bad: `self.agents.remove(walker)`, while `terminations[walker]` is False.

    Good: `terminations[walker] = True` in the step that removes it.
    """
    for trace in evidence["rollout"]:
        live: frozenset[str] = frozenset()
        ended: set[str] = set()
        for turn in trace.turns:
            new = ended_in(turn)
            ended |= new
            left = live - turn.live
            is_over = not turn.live and len(left) > 1 and bool(left & new)
            left = left & ended if is_over else left  # at the others GK502 looks
            if not is_twofold(turn):
                for agent in sorted(left):
                    if not _may_leave(contract, agent):
                        yield Occasion(
                            trace.at(turn, agent, "agents"), agent in ended,
                            "a termination or a truncation", "it is gone without either",
                            proof=PROOF,
                        )  # fmt: skip
            live = turn.live


def _may_leave(contract: Contract, agent: str) -> bool:
    name = contract.role_of(agent)
    return bool(name is not None and contract.roles[name].may_leave)
