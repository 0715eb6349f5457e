"""GK500."""

from __future__ import annotations

from collections.abc import Iterator, Set
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._rosters import plays_with_rosters
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.trace import Trace, Turn

KINDS: Final = {"termination": "terminated", "truncation": "truncated"}
PROOF: Final = {
    "parallel": """\
ended = [a for a in terminations if terminations[a] or truncations.get(a)]
going_on = [a for a in env.agents if a not in ended]
assert not (ended and going_on), (ended, going_on)""",
    "aec": """\
ended = [a for a in env.agents if env.terminations[a] or env.truncations[a]]
going_on = [a for a in env.agents if a not in ended]
assert not (ended and going_on), (ended, going_on)""",
}


def _undeclared(contract: Contract, evidence: Gathered) -> str | None:
    owners = {ending.owner for ending in contract.endings.values()} - {None, "agent"}
    return None if owners else "no ending is declared to be everybody's, or a role's"


@check(
    "GK500",
    needs=("rollout",),
    severity=HIGH,
    mend="end every agent that the ending belongs to in the same step, or declare its owner as it "
    "is",
    applies=_undeclared,
)
def endings_reach_all_whom_they_are_declared_for(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """An ending that is declared to be everybody's, or a role's, ends all of them at once.

    Who goes on playing after the game is over for the others earns rewards in a world that the
    rules don't describe.

    Bad: `cleared = { kind = "termination", owner = "all" }`, and only the carrier terminates.

    Good: `terminations = dict.fromkeys(self.agents, self.is_cleared)`.
    """
    for trace, rosters in plays_with_rosters(evidence):
        known: set[str] = set()
        for turn in trace.turns:
            new = turn.ended - known
            known |= turn.ended
            roster = rosters[turn.index - 1] if 0 < turn.index <= len(rosters) else []
            for agent in sorted(new & set(roster)):
                owed = _owners(contract, trace, turn, agent, roster)
                if owed is None:
                    continue
                left = sorted(owed - known)
                yield Occasion(
                    trace.at(turn, agent, "endings"), not left, "all of them end with it",
                    f"{', '.join(left)} went on", proof=PROOF[evidence.api],
                )  # fmt: skip


def _owners(
    contract: Contract, trace: Trace, turn: Turn, agent: str, roster: list[str]
) -> Set[str] | None:
    """Whom the agent's ending has to end too; None where that isn't declared."""
    reason = trace.endings.get(agent)
    if reason is not None:
        declared = contract.endings.get(reason)
        owner = None if declared is None else declared.owner
    else:  # no reason is named: only where all endings of the kind are everybody's
        flags = {kind for kind, name in KINDS.items() if getattr(turn, name).get(agent)}
        owners = {each.owner for each in contract.endings.values() if each.kind in flags}
        owner = "all" if owners == {"all"} else None
    if owner in (None, "agent"):
        return None
    return {a for a in roster if owner == "all" or contract.role_of(a) == owner}
