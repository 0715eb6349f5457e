"""GK502."""

from __future__ import annotations

from collections.abc import Iterator

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._endings import ended_in, is_twofold
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered

PROOF = """\
silent = [a for a in ACTIONS[-1] if not terminations.get(a) and not truncations.get(a)]
assert env.agents or not silent, silent"""


@check(
    "GK502",
    needs=("rollout",),
    severity=HIGH,
    mend="where one agent's end is the end for all, terminate (or truncate) all of them in that "
    "step; else keep the others in `agents`",
    api="parallel",
)
def the_episode_is_over_for_those_who_ended(
    contract: Contract, evidence: Gathered
) -> Iterator[Occasion]:
    """No end of one empties `agents` while the others neither terminate nor truncate.

    The others' last step looks like any other: their returns are bootstrapped from a state that
    nobody ever plays on from.

    Bad: `if any(terminations.values()): self.agents = []`.

    Good: the same, after `terminations = dict.fromkeys(terminations, True)`.
    """
    for trace in evidence["rollout"]:
        live: frozenset[str] = frozenset()
        for turn in trace.turns:
            ended = ended_in(turn) & live
            if ended and not turn.live and not is_twofold(turn):
                silent = sorted(live - ended)
                yield Occasion(
                    trace.at(turn, silent[0] if silent else None, "agents"), not silent,
                    "a termination or a truncation of everybody",
                    f"{', '.join(sorted(ended))} ended, and {', '.join(silent)} "
                    "stopped without either",
                    proof=PROOF,
                )  # fmt: skip
            live = turn.live
