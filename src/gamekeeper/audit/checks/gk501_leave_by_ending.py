"""GK501."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gamekeeper.audit.check import HIGH, Occasion, check
from gamekeeper.audit.checks._endings import ended_in, is_twofold
from gamekeeper.audit.checks._schedule import crossings
from gamekeeper.core.contract import Contract
from gamekeeper.core.gathered import Gathered
from gamekeeper.core.proof import Proof
from gamekeeper.core.trace import Trace

PROOFS: Final = {
    "parallel": Proof("""\
gone = [agent for agent in ACTIONS[-1] if agent not in env.agents]
silent = [a for a in gone if not terminations.get(a) and not truncations.get(a)]
assert not silent, silent"""),
    "aec": Proof(
        """\
env = make()
env.reset(seed=SEED)
ended = set()
for action in ACTIONS:
    before = list(env.agents)
    env.last()
    env.step(action)
    flagged = {**env.terminations, **env.truncations}
    ended |= {a for a in flagged if env.terminations.get(a) or env.truncations.get(a)}
silent = [a for a in before if a not in env.agents and a not in ended]
assert not silent, silent""",
        plays=False,
    ),
}


@check(
    "GK501",
    needs=("rollout",),
    severity=HIGH,
    mend="set the agent's termination or truncation in the step that takes it out of `agents`, "
    "or declare may_leave for its role",
)
def agents_leave_by_ending(contract: Contract, evidence: Gathered) -> Iterator[Occasion]:
    """An agent leaves `agents` only once it has terminated or truncated, and the flag says so.

    A learner that sees no end waits for an agent that never acts again, and bootstraps from
    nothing.

    Bad: `self.agents.remove(walker)`, while `terminations[walker]` is False.

    Good: `terminations[walker] = True` in the step that removes it.
    """
    left = _left_a_turn if evidence.api == "aec" else _left_a_tick
    for trace, turn, agent, has_ended in left(evidence):
        if not _may_leave(contract, agent):
            yield Occasion(
                trace.at(turn, agent, "agents"), has_ended,
                "a termination or a truncation", "it is gone without either",
                proof=PROOFS[evidence.api],
            )  # fmt: skip


def _left_a_tick(evidence: Gathered) -> Iterator[tuple[Trace, int, str, bool]]:
    """Who left at which turn of a Parallel play, and whether its flags had been up."""
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
                yield from ((trace, turn.index, agent, agent in ended) for agent in sorted(left))
            live = turn.live


def _left_a_turn(evidence: Gathered) -> Iterator[tuple[Trace, int, str, bool]]:
    """Who left at which turn of an AEC play, and whether its flags had been up, or now are."""
    for play in crossings(evidence):
        leaving = {each.turn + 1: each for each in play if set(each.before) - set(each.after)}
        for turn in play[0].trace.turns if leaving else ():
            if turn.index in leaving:
                each = leaving[turn.index]
                for agent in sorted(set(each.before) - set(each.after)):
                    yield each.trace, turn.index, agent, agent in each.ended | ended_in(turn)


def _may_leave(contract: Contract, agent: str) -> bool:
    name = contract.role_of(agent)
    return bool(name is not None and contract.roles[name].may_leave)
