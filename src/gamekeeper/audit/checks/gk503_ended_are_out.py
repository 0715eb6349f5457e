"""GK503."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._endings import ended_in
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

PROOF = """\
ended = [a for a in env.agents if terminations.get(a) or truncations.get(a)]
assert not ended, ended"""


@check(
    "GK503",
    needs=("rollout",),
    severity=HIGH,
    mend="take agents that terminate or truncate out of `agents` before step returns; when the "
    "episode is over, `self.agents = []`",
    api="parallel",
)
def the_ended_are_out_of_agents(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An agent that has terminated or truncated is out of `agents` when that step returns.

    `while env.agents` is how an episode is played: where `agents` isn't emptied at the end it goes
    on for ever, and where one stays in it the dead are asked for actions.

    Bad: `truncations = dict.fromkeys(self.agents, True)`, and `agents` stays as it was.

    Good: `self.agents = [a for a in self.agents if not (terminations[a] or truncations[a])]`.
    """
    for trace in evidence["rollout"]:
        for turn in trace.turns:
            ended = ended_in(turn)
            if not ended or not turn.index:
                continue
            still = sorted(ended & turn.live)
            yield Occasion(
                trace.at(turn, still[0] if still else None, "agents"), not still,
                "only those who go on", f"{', '.join(still)} ended, and stays", proof=PROOF,
            )  # fmt: skip
