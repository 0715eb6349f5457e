"""GK505."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._endings import ended_in
from gamekeeper.audit.checks._rosters import plays_with_rosters
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

PROOF = """\
env.reset(seed=SEED)
ended = set()
for action in ACTIONS:
    env.last()
    env.step(action)
    ended &= set(env.agents)
    back = [a for a in ended if not env.terminations[a] and not env.truncations[a]]
    assert not back, back
    ended |= {a for a in env.agents if env.terminations[a] or env.truncations[a]}"""


@check(
    "GK505",
    needs=("rollout",),
    severity=HIGH,
    mend="keep the flag up until the agent is out of `agents`; set flags where an agent ends, "
    "don't work them out anew in every step",
    api="aec",
)
def an_ending_is_final(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """The flags of an agent that has ended aren't taken back while it is still in `agents`.

    In the one step the learner closes the agent's trajectory, in the next it is told that nothing
    has happened.

    Bad: `self.terminations = {a: self.energy[a] <= 0 for a in self.agents}`, and energy comes back.

    Good: `if self.energy[a] <= 0: self.terminations[a] = True`.
    """
    for trace, rosters in plays_with_rosters(evidence):
        ended: set[str] = set()
        for turn in trace.turns:
            roster = set(rosters[turn.index]) if turn.index < len(rosters) else set()
            ended &= roster
            for agent in sorted(ended & turn.live):
                flags = turn.terminated.get(agent), turn.truncated.get(agent)
                if flags == (None, None):
                    continue  # nothing is said of it at this turn
                yield Occasion(
                    trace.at(turn, agent, "terminations"), agent in ended_in(turn),
                    "terminated or truncated, as before", "neither", proof=PROOF,
                )  # fmt: skip
            ended |= turn.ended & roster
