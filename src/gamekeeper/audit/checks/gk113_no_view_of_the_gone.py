"""GK113."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import LOW, Occasion, check
from gamekeeper.audit.checks._entries import AT_RESET, PARTS, given, place
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK113",
    needs=("rollout",),
    severity=LOW,
    mend="build observations and infos over those who acted in this step (and who joined in it), "
    "not over possible_agents",
    api="parallel",
)
def the_gone_are_shown_nothing(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An agent that has left the game stands no longer in observations or infos.

    Whoever takes the keys of the observations for the agents that are to act next hands over
    actions of the dead, and stores steps that they never made.

    Bad: `observations = {a: see(a) for a in self.possible_agents}` in every step.

    Good: `observations = {a: see(a) for a in acting}`.
    """
    for trace in evidence["rollout"]:
        ever: set[str] = set()
        for each in given(trace):
            ever |= each.turn.live
            gone = (set(each.turn.agents) & ever) - each.turn.live - each.before - each.acted
            bad = [(a, part) for a in sorted(gone) for part in sorted(each.has(a) & AT_RESET)]
            for agent, part in bad:
                yield Occasion(
                    place(trace, each.turn, agent, part), False, "no entry: it has left",
                    f"an entry in {PARTS[part]}", proof=_proof(part),
                )  # fmt: skip
            if not bad:
                yield Occasion(trace.at(each.turn, None, "agents"), True)


def _proof(part: str) -> str:
    return (
        f"gone = set({PARTS[part]}) & set(env.possible_agents)\n"
        "gone -= set(env.agents) | set(ACTIONS[-1])\n"
        "assert not gone, gone"
    )
