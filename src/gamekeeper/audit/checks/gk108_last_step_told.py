"""GK108."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._entries import PARTS, given, place
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered


@check(
    "GK108",
    needs=("rollout",),
    severity=HIGH,
    mend="build the dictionaries of a step over those who acted in it, before the ones that ended "
    "are taken out of `agents`",
    api="parallel",
)
def the_last_step_is_told_whole(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An agent that ends is given its last reward, last observation and both flags in that step.

    The reward for winning or dying is most often the last one. Without its entry the agent never
    learns of it, and without the last observation a truncated return can't be bootstrapped.

    Bad: `self.agents` loses the dead, then `rewards = {a: pay[a] for a in self.agents}`.

    Good: `rewards = {a: pay[a] for a in acting}`, with `acting` as it was before the step.
    """
    for trace in evidence["rollout"]:
        for each in given(trace):
            for agent in sorted(each.acted - each.turn.live):
                if not each.has(agent) or agent not in each.turn.agents:
                    continue  # nothing is told of it at all: it left without ending
                lost = sorted(each.missing.get(agent, frozenset()) - {"info"})
                for part in lost:
                    yield Occasion(
                        place(trace, each.turn, agent, part), False,
                        "an entry in the step that ends the agent", "no entry", proof=_proof(part),
                    )  # fmt: skip
                if not lost:
                    yield Occasion(trace.at(each.turn, agent, "agents"), True)


def _proof(part: str) -> str:
    return (
        "ended = [agent for agent in ACTIONS[-1] if agent not in env.agents]\n"
        f"missing = [agent for agent in ended if agent not in {PARTS[part]}]\n"
        "assert not missing, missing"
    )
